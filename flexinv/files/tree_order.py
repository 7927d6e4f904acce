"""Order joints into a tree, parents before children; anything that is no tree is an error that names it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from flexinv.files.toml_tables import complaint
from flexinv.model.mechanism import WORLD, Joint
from flexinv.validation import nearest

# ("joint" or "link", its name, the key) -> the words that name the place in the file
Where = Callable[[str, str, str], str]


def depth_first(joints: Sequence[Joint], links: Iterable[str], where: Where) -> tuple[Joint, ...]:
    """Return the joints depth-first from the world, children in the order given [-].

    InputError: a joint to nowhere, two joints that carry one link, a cycle, a link that nothing carries.
    """
    names = dict.fromkeys(links)
    check_ends(joints, [WORLD, *names], names, where)
    _check_carried_once(joints, where)
    children: dict[str, list[Joint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    waiting = children.get(WORLD, [])[::-1]
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting.extend(children.get(joint.child, [])[::-1])
    _check_all_reached(ordered, joints, names, where)
    return tuple(ordered)


def check_ends(joints: Sequence[Joint], parents: Iterable[str], links: Iterable[str], where: Where) -> None:
    """Check that every joint joins two links that exist [-]; InputError names a joint to nowhere."""
    ends = {"parent": dict.fromkeys(parents), "child": dict.fromkeys(links)}
    for joint in joints:
        for key, known in ends.items():
            name = joint.parent if key == "parent" else joint.child
            if name not in known:
                near = nearest(name, known)
                expected = "one of the links " + ", ".join(list(known)[:20]) + (", ..." if len(known) > 20 else "")
                advice = f'{key} = "{near}"' if near else f"a link {name}, or the name of one that exists"
                raise complaint(where("joint", joint.name, key), f'{key} = "{name}"', expected, advice)
        if joint.parent == joint.child:
            given = f'parent and child are both "{joint.child}"'
            raise complaint(where("joint", joint.name, "child"), given, "two links", "another parent")


def _check_carried_once(joints: Sequence[Joint], where: Where) -> None:
    carrier: dict[str, str] = {}
    for joint in joints:
        first = carrier.setdefault(joint.child, joint.name)
        if first != joint.name:
            given = f'child = "{joint.child}", which joint {first} carries already'
            expected = "a tree: one joint carries each link; what closes a loop is a closure"
            advice = f"[closures.{joint.name}] with kind, first and second in a mechanism file instead of this joint"
            raise complaint(where("joint", joint.name, "child"), given, expected, advice)


def _check_all_reached(ordered: list[Joint], joints: Sequence[Joint], links: dict[str, None], where: Where) -> None:
    reached = {joint.child for joint in ordered}
    carried = {joint.child: joint for joint in joints}
    unreached = [link for link in links if link not in reached]
    for link in unreached:
        if link not in carried:
            expected = "every link carried by one joint"
            advice = f'a joint with child = "{link}" and parent = "{WORLD}" or another link'
            raise complaint(where("link", link, ""), "a link that no joint carries", expected, advice)
    if (
        unreached
    ):  # each of them is carried, none from the world: they go round, from a link along its parents back to itself
        path = [unreached[0]]
        while path[-1] not in path[:-1]:
            path.append(carried[path[-1]].parent)
        path = path[path.index(path[-1]) :]
        given = f"a cycle: {' <- '.join(path)}"
        joint = carried[path[-1]].name
        expected = f'a tree that hangs on "{WORLD}"; what closes a loop is a closure'
        advice = f'parent = "{WORLD}" for one of these joints; [closures.{joint}] with first and second where the loop closes'
        raise complaint(where("joint", joint, "parent"), given, expected, advice)
