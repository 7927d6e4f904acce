"""Mistakes with masses, centres of mass and inertia tensors: numbers of the right body in the wrong form, or of another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from flexinv.model.mechanism import Body, Inertia, Link, Mechanism

CHAPTER = RecipeTopic("masses and inertias")
MASSES = ("mass", "payload", "missing body")
POUND = 0.45359237  # kg


def _draw_body(scenario: FaultScenario, rng: np.random.Generator, wide: bool = False) -> tuple[Link, Body] | None:
    """A moving body by lot; wide : one with a tensor that is more than rounding."""
    known = edits.list_moving_bodies(scenario.mechanism)
    if wide:
        known = [(link, body) for link, body in known if np.abs(body.inertia.tensor).max() > 0.0]
    result: tuple[Link, Body] | None = draw_one(rng, known)
    return result


def _draw_listed_body(known: list[tuple[Link, Body]], rng: np.random.Generator) -> tuple[Link, Body] | None:
    """One of these by lot."""
    listed_body: tuple[Link, Body] | None = draw_one(rng, known)
    return listed_body


def _list_place_names(scenario: FaultScenario, link: Link, body: Body) -> tuple[str, ...]:
    return edits.list_body_names(scenario.mechanism, link.name, body.name)


def _make_inertia_fault(
    scenario: FaultScenario, link: Link, body: Body, words: str, kinds: tuple[str, ...], new: Inertia
) -> Fault:
    """A fault whose whole effect is another inertia of one body."""
    at = _list_place_names(scenario, link, body)
    near = tuple(k for k in ("mass", "payload", "com", "inertia", "mix-up") if k not in kinds)
    return Fault(
        f"{words} of {link.name}/{body.name}",
        ((CorrectAnswer(kinds, at),),),
        (CorrectAnswer(near, at),),
        lambda m: edits.replace_inertia(m, link.name, body.name, lambda _: new),
    )


@CHAPTER("mass", 2e-5, 0.01, 0.05, 0.5)
def make_mass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The mass alone is off, as when it was weighed with or without its screws."""
    if (body := _draw_body(scenario, rng)) is None:
        return None
    factor = 1.0 + size * rng.choice([-1.0, 1.0])
    old = body[1].inertia
    return _make_inertia_fault(
        scenario, *body, f"mass x{factor:.5g}", ("mass",), old.replace_unchecked(mass=old.mass * factor)
    )


@CHAPTER("mass and tensor", 2e-5, 0.01, 0.05, 0.3)
def make_material_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Another material: mass and tensor in the same ratio."""
    if (body := _draw_body(scenario, rng)) is None:
        return None
    factor = 1.0 + size * rng.choice([-1.0, 1.0])
    old = body[1].inertia
    new = old.replace_unchecked(mass=old.mass * factor, tensor=old.tensor * factor)
    return _make_inertia_fault(scenario, *body, f"mass and tensor x{factor:.5g}", ("mass",), new)


@CHAPTER("pounds for kilograms", 1.0)
def make_pound_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The mass of one body was given in pounds and taken for kilograms, or the other way round."""
    if (body := _draw_body(scenario, rng)) is None:
        return None
    factor = rng.choice([POUND, 1.0 / POUND])
    old = body[1].inertia
    return _make_inertia_fault(
        scenario, *body, f"mass x{factor:.4g} (pounds)", ("mass",), old.replace_unchecked(mass=old.mass * factor)
    )


@CHAPTER("all masses", 2e-5, 0.01, 0.05, 1.2)
def make_density_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """One density, or one unit, of all bodies and beams is off."""
    factor = 1.0 + size

    def update_mechanism(mechanism: Mechanism) -> Mechanism:
        mechanism = edits.replace_all_inertias(
            mechanism, lambda i: i.replace_unchecked(mass=i.mass * factor, tensor=i.tensor * factor)
        )
        for link in mechanism.beams:
            mechanism = edits.replace_section(
                mechanism,
                link.name,
                lambda s: replace(
                    s, mass_per_length=s.mass_per_length * factor, rotary_inertia=s.rotary_inertia * factor
                ),
            )
        return mechanism

    names = [link.name for link in scenario.mechanism.links]
    alone = edits.list_moving_bodies(scenario.mechanism) if len(scenario.mechanism.beams) == 0 else []
    only = _list_place_names(scenario, *alone[0]) if len(alone) == 1 else tuple(names) if len(names) == 1 else ()
    right = (CorrectAnswer(("mass", "beam mass"), (ALL, *only)),)
    return Fault(
        f"all masses and tensors x{factor:.5g}", (right,), (CorrectAnswer(("mass", "beam mass")),), update_mechanism
    )


@CHAPTER("centre of mass along", 5e-5, 0.02, 0.1)
def make_com_distance_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The centre of mass stands a part of its distance farther out or in."""
    known = [
        (link, b) for link, b in edits.list_moving_bodies(scenario.mechanism) if np.linalg.norm(b.inertia.com) > 1e-6
    ]
    if (listed_body := _draw_listed_body(known, rng)) is None:
        return None
    factor = 1.0 + size * rng.choice([-1.0, 1.0])
    old = listed_body[1].inertia
    return _make_inertia_fault(
        scenario, *listed_body, f"centre of mass x{factor:.5g}", ("com",), old.replace_unchecked(com=old.com * factor)
    )


@CHAPTER("centre of mass aside", 1e-6, 1e-3, 1e-2)
def make_com_offset_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The centre of mass stands beside where it is, by some millimetres in any direction."""
    if (body := _draw_body(scenario, rng)) is None:
        return None
    way = rng.normal(size=3)
    by = size * way / np.linalg.norm(way)
    old = body[1].inertia
    return _make_inertia_fault(
        scenario, *body, f"centre of mass off by {size:.3g} m", ("com",), old.replace_unchecked(com=old.com + by)
    )


@CHAPTER("all centres of mass", 0.02, 0.002)
def make_com_scale_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """All centres of mass are out by the same part: one length scale of the drawing."""
    known = edits.list_moving_bodies(scenario.mechanism)
    if not known or not any(body.inertia.com.any() for _, body in known):
        return None
    factor = 1.0 + size * rng.choice([-1.0, 1.0])
    near = tuple(CorrectAnswer(("com",), _list_place_names(scenario, *one)) for one in known)
    alone = _list_place_names(scenario, *known[0]) if len(known) == 1 else ()
    return Fault(
        f"all centres of mass x{factor:.4g}",
        ((CorrectAnswer(("com",), (ALL, *alone)),),),
        near,
        lambda m: edits.replace_all_inertias(m, lambda i: i.replace_unchecked(com=i.com * factor)),
    )


@CHAPTER("parallel axis twice", 1.0)
def make_origin_tensor_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The tensor about the origin was written where the one about the centre of mass belongs."""
    known = [
        (link, b) for link, b in edits.list_moving_bodies(scenario.mechanism) if np.linalg.norm(b.inertia.com) > 1e-3
    ]
    if (listed_body := _draw_listed_body(known, rng)) is None:
        return None
    old = listed_body[1].inertia
    new = old.replace_unchecked(tensor=old.tensor + edits.compute_parallel_axis_term(old.mass, old.com))
    return _make_inertia_fault(
        scenario, *listed_body, "tensor about the origin for the one about the centre", ("inertia",), new
    )


@CHAPTER("parallel axis taken off", 1.0, 0.5)
def make_parallel_axis_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The parallel-axis term was subtracted once too often, as far as a body can have what is left."""
    known = []
    for link, body in edits.list_moving_bodies(scenario.mechanism):
        left = body.inertia.tensor - size * edits.compute_parallel_axis_term(body.inertia.mass, body.inertia.com)
        if body.inertia.com.any() and edits.is_inertia_tensor(left):
            known.append((link, body, left))
    if (one := draw_one(rng, known)) is None:
        return None
    link, body, left = one
    return _make_inertia_fault(
        scenario,
        link,
        body,
        "parallel-axis term taken off the tensor",
        ("inertia",),
        body.inertia.replace_unchecked(tensor=left),
    )


@CHAPTER("all tensors about the origin", 1.0)
def make_all_tensors_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """All tensors are given about the links' origins to an engine that wants them about the centres of mass."""
    known = [one for one in edits.list_moving_bodies(scenario.mechanism) if one[1].inertia.com.any()]
    if not known:
        return None
    near = tuple(CorrectAnswer(("inertia",), _list_place_names(scenario, *one)) for one in known)
    alone = _list_place_names(scenario, *known[0]) if len(known) == 1 else ()
    return Fault(
        "all tensors about the origins",
        ((CorrectAnswer(("inertia",), (ALL, *alone)),),),
        near,
        lambda m: edits.replace_all_inertias(
            m, lambda i: i.replace_unchecked(tensor=i.tensor + edits.compute_parallel_axis_term(i.mass, i.com))
        ),
    )


@CHAPTER("tensor turned", 0.02, 0.3, np.pi / 2)
def make_tensor_rotation_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The tensor is along other axes than the body's: exported from another frame."""
    if (body := _draw_body(scenario, rng, wide=True)) is None:
        return None
    old = body[1].inertia
    turn = edits.compute_rotation(rng.normal(size=3), size)
    new = old.replace_unchecked(tensor=turn @ old.tensor @ turn.T)
    return _make_inertia_fault(scenario, *body, f"tensor turned by {size:.3g} rad", ("inertia",), new)


@CHAPTER("products of inertia", 1.0)
def make_product_sign_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The products of inertia have the other sign (CAD programs do not agree on it)."""
    known = []
    for link, body in edits.list_moving_bodies(scenario.mechanism):
        tensor = body.inertia.tensor
        if np.abs(tensor - np.diag(np.diag(tensor))).max() > 1e-3 * np.abs(tensor).max():
            known.append((link, body))
    if (listed_body := _draw_listed_body(known, rng)) is None:
        return None
    old = listed_body[1].inertia
    new = old.replace_unchecked(tensor=2.0 * np.diag(np.diag(old.tensor)) - old.tensor)
    return _make_inertia_fault(scenario, *listed_body, "products of inertia of the other sign", ("inertia",), new)


@CHAPTER("xx for zz", 1.0)
def make_moment_exchange_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Two moments of inertia are in each other's place."""
    if (body := _draw_body(scenario, rng, wide=True)) is None:
        return None
    order = draw_one(rng, [[2, 1, 0], [1, 0, 2], [0, 2, 1]])
    old = body[1].inertia
    new = old.replace_unchecked(tensor=old.tensor[np.ix_(order, order)])
    return _make_inertia_fault(scenario, *body, "two moments of inertia exchanged", ("inertia",), new)


@CHAPTER("tensor", 1e-4, 0.05, 0.5)
def make_tensor_scale_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The tensor alone is off: a solid body for a hollow one."""
    if (body := _draw_body(scenario, rng, wide=True)) is None:
        return None
    old = body[1].inertia
    factor = 1.0 + size
    return _make_inertia_fault(
        scenario, *body, f"tensor x{factor:.5g}", ("inertia",), old.replace_unchecked(tensor=old.tensor * factor)
    )


@CHAPTER("tensor in other units", 1e-4, 4.214e-2, 2.93e-4, 10.0)
def make_tensor_unit_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The tensor is in kg cm^2, lb ft^2 or lb in^2 where kg m^2 are wanted, or has its decimal point elsewhere."""
    if (body := _draw_body(scenario, rng, wide=True)) is None:
        return None
    old = body[1].inertia
    return _make_inertia_fault(
        scenario, *body, f"tensor x{size:.4g} (units)", ("inertia",), old.replace_unchecked(tensor=old.tensor * size)
    )


@CHAPTER("point masses", 1.0)
def make_point_mass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """All bodies are point masses: no tensor was given (one is left small enough for every engine)."""
    known = [one for one in edits.list_moving_bodies(scenario.mechanism) if one[1].inertia.tensor.any()]
    if not known:
        return None
    near = tuple(CorrectAnswer(("inertia",), _list_place_names(scenario, *one)) for one in known)
    alone = _list_place_names(scenario, *known[0]) if len(known) == 1 else ()
    return Fault(
        "all bodies are points",
        ((CorrectAnswer(("inertia",), (ALL, *alone)),),),
        near,
        lambda m: edits.replace_all_inertias(m, lambda i: i.replace_unchecked(tensor=i.tensor * 1e-9)),
    )


@CHAPTER("size of a body", 0.01, 0.05)
def make_longer_body_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A body was drawn longer: centre of mass farther out, tensor larger by the square, mass as weighed."""
    known = [
        (link, b) for link, b in edits.list_moving_bodies(scenario.mechanism) if np.linalg.norm(b.inertia.com) > 1e-3
    ]
    if (listed_body := _draw_listed_body(known, rng)) is None:
        return None
    old = listed_body[1].inertia
    factor = 1.0 + size
    new = old.replace_unchecked(com=old.com * factor, tensor=old.tensor * factor**2)
    return _make_inertia_fault(scenario, *listed_body, f"a body x{factor:.4g} as long", ("com", "inertia"), new)


@CHAPTER("bodies exchanged", 1.0)
def make_body_exchange_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Two links carry each other's inertia: rows of a table were mixed up."""
    known = [one for one in edits.list_moving_bodies(scenario.mechanism) if one[1].station is None]
    if len(known) < 2:
        return None
    a, b = (known[int(k)] for k in rng.choice(len(known), 2, replace=False))

    def update_mechanism(mechanism: Mechanism) -> Mechanism:
        mechanism = edits.replace_inertia(mechanism, a[0].name, a[1].name, lambda _: b[1].inertia)
        return edits.replace_inertia(mechanism, b[0].name, b[1].name, lambda _: a[1].inertia)

    at = (*_list_place_names(scenario, *a), *_list_place_names(scenario, *b))
    own = ("mass", "com", "inertia")
    return Fault(
        f"inertias of {a[0].name} and {b[0].name} exchanged",
        ((CorrectAnswer(("mix-up",), at),),),
        (CorrectAnswer(own, at),),
        update_mechanism,
        same=(
            (CorrectAnswer(own, _list_place_names(scenario, *a)),),
            (CorrectAnswer(own, _list_place_names(scenario, *b)),),
        ),
    )


@CHAPTER("body missing", 1.0)
def make_missing_body_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A payload, a tool or a link's body was forgotten (a trace is left for engines that refuse none at all)."""
    if (found := _draw_body(scenario, rng)) is None:
        return None
    link, body = found
    new = body.inertia.replace_unchecked(mass=body.inertia.mass * 1e-9, tensor=body.inertia.tensor * 1e-9)
    return _make_inertia_fault(scenario, link, body, "missing: the body", ("mass", "missing body"), new)


@CHAPTER("payload at its flange", 1.0)
def make_payload_com_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A payload hangs at the frame that carries it: its own centre of mass was forgotten."""
    known = [one for one in edits.list_moving_bodies(scenario.mechanism) if one[1].inertia.com.any()]
    if (listed_body := _draw_listed_body(known, rng)) is None:
        return None
    old = listed_body[1].inertia
    return _make_inertia_fault(
        scenario, *listed_body, "centre of mass at the frame", ("com",), old.replace_unchecked(com=np.zeros(3))
    )


@CHAPTER("payload on another link", 1.0)
def make_wrong_link_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A body hangs on another link than its own."""
    known = [one for one in edits.list_moving_bodies(scenario.mechanism) if one[1].station is None]
    others = [link for link in scenario.mechanism.links if link.beam is None and link.bodies]
    if len(known) < 2:
        return None
    link, body = draw_one(rng, known)
    other = draw_one(rng, [o for o in others if o.name != link.name])
    if other is None:
        return None

    def update_mechanism(mechanism: Mechanism) -> Mechanism:
        small = body.inertia.replace_unchecked(mass=body.inertia.mass * 1e-9, tensor=body.inertia.tensor * 1e-9)
        mechanism = edits.replace_inertia(mechanism, link.name, body.name, lambda _: small)
        moved = replace(body, name=f"{body.name} of {link.name}")
        return edits.replace_link(mechanism, other.name, lambda one: replace(one, bodies=(*one.bodies, moved)))

    at = (*_list_place_names(scenario, link, body), *edits.list_body_names(scenario.mechanism, other.name))
    near = (CorrectAnswer(("mass", "missing body", "payload", "com", "inertia"), at),)
    words = f"{link.name}/{body.name} on {other.name} instead"
    gone = CorrectAnswer(("mass", "missing body"), _list_place_names(scenario, link, body))
    more = CorrectAnswer(("mass", "payload"), edits.list_body_names(scenario.mechanism, other.name))
    return Fault(words, ((CorrectAnswer(("mix-up",), at),),), near, update_mechanism, same=((gone,), (more,)))


@CHAPTER("tool not counted", 0.002, 0.05, 0.3)
def make_tool_mass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Something hangs at the tip that the other model does not have: a part of the mass of its link."""
    rigid = [
        (link, body)
        for link, body in edits.list_moving_bodies(scenario.mechanism)
        if link.beam is None and link.tip.any()
    ]
    if (found := draw_one(rng, rigid)) is None:
        return None
    link, body = found
    more = Body("unseen tool", Inertia(size * body.inertia.mass, link.tip, 1e-9 * np.eye(3)))
    at = edits.list_body_names(scenario.mechanism, link.name)
    return Fault(
        f"{more.inertia.mass:.3g} kg more at the tip of {link.name}",
        ((CorrectAnswer(("payload",), at),),),
        (CorrectAnswer(("mass", "com", "inertia"), at),),
        lambda m: edits.replace_link(m, link.name, lambda one: replace(one, bodies=(*one.bodies, more))),
    )


@CHAPTER("motor in the joint", 0.02, 0.3)
def make_motor_mass_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The mass of a motor sits in the joint that it drives: a part of the mass of the link, at the link's origin."""
    rigid = [(link, body) for link, body in edits.list_moving_bodies(scenario.mechanism) if link.beam is None]
    rigid = [one for one in rigid if edits.find_parent_joint(scenario.mechanism, one[0].name).parent != "world"]
    if (found := draw_one(rng, rigid)) is None:
        return None
    link, body = found
    more = Body("motor", Inertia(size * body.inertia.mass, np.zeros(3), 1e-9 * np.eye(3)))
    parent = edits.find_parent_joint(scenario.mechanism, link.name).parent
    at = (*edits.list_body_names(scenario.mechanism, link.name), *edits.list_body_names(scenario.mechanism, parent))
    return Fault(
        f"{more.inertia.mass:.3g} kg more in the joint of {link.name}",
        ((CorrectAnswer(MASSES, at),),),
        (CorrectAnswer(("com", "inertia"), at),),
        lambda m: edits.replace_link(m, link.name, lambda one: replace(one, bodies=(*one.bodies, more))),
    )
