"""The files of a C library beside its machine code: header, source, examples, self-test, packages for CMake, a page to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from importlib import resources
from string import Template

import flexinv
from flexinv.export.library_plan import GoldenSeries, LibraryPlan
from flexinv.export.machine_code import NATIVE
from flexinv.export.memory_image import ALIGNMENT
from flexinv.export.names import format_comment, format_markdown, format_numbers, format_string, make_words
from flexinv.kinematics.nodal_motion import list_sliding_coordinates
from flexinv.model.mechanism import Mechanism

LAYOUT = 4  # of the block; another number wherever the header's functions or the meaning of the block change
# Name -> meaning, in the order of their numbers.
STATUSES = {
    "OK": "done",
    "NULL": "a pointer is NULL",
    "NOT_ALIGNED": "the address of the block is no multiple of what alignment() returns",
    "TOO_SMALL": "the block is smaller than what size() returns",
    "WRONG_LAYOUT": "the program was compiled with the header of another layout; compile it again",
    "NOT_STARTED": "the block was not begun with start(), or is over; call start()",
    "MOVED": "the block was moved by hand; use copy()",
    "NOT_FINITE": "a number that is given is infinite or not a number",
    "BAD_VALUE": "a mass, an inertia, friction or an index that cannot be",
    "OUT_OF_RANGE": "cosine and sine or a quaternion are no rotation, or an effort is too large for a number",
    "NO_SOLUTION": "the step found no solution; the block stands where it stood: give a shorter motion, or export a shorter step",
    "BENT_TOO_FAR": "a beam turns too far within one element; the block stands where it stood: give a shorter motion",
    "ENERGY": "energy comes from nowhere: the motion jumps, or qd is not its rate; the block is over until start() or a copy()",
    "NOT_CLOSED": "q, qd or qdd do not keep the closed loops; give the consistent motion of all joints",
    "SINGULAR": "a closed loop is so near a singular position that its forces are not certain; keep away from it",
    "OUT_OF_PLANE": "gravity or a payload would leave the plane in which the library marches",
    "FAILED": "the machine code gave up, which it never should",
}

# Kind of library -> how long a call may take, in words.
BOUNDS = {
    "rigid": "no loop of `torque` depends on the numbers given.",
    "flexible": "a step makes at most 40 iterations of Newton's method, usually two or three, and `start_at` at most a few "
    "thousand steps.",
}


def render_files(plan: LibraryPlan, prefix: str, targets: Sequence[str]) -> dict[str, str]:
    """Return path in the folder -> text [-] of all files that a C compiler and a reader need."""
    kind = plan.kind
    values = _collect_values(plan, prefix, targets)
    parts = plan.parts
    header, source = render_sources(plan, prefix)
    values["but"] = "" if kind == "rigid" else "; `ENERGY` alone ends the block"
    values["bound"] = BOUNDS[kind]
    values["notes"] = _join(parts, "md", values)
    return {
        f"include/{prefix}.h": header,
        f"src/{prefix}.c": source,
        "example.c": fill_template(f"{kind}_example.c", values),
        "example.cpp": fill_template("example.cpp", values),
        "src/selftest.c": fill_template("selftest.c", values),
        f"lib/cmake/{prefix}Config.cmake": fill_template("config.cmake", values),
        f"lib/pkgconfig/{prefix}.pc": fill_template("package.pc", values),
        "README.md": fill_template("readme.md", values),
    }


def render_sources(plan: LibraryPlan, prefix: str) -> tuple[str, str]:
    """Return the header and the C file [-] of a library."""
    values = _collect_values(plan, prefix, [NATIVE])
    values["functions"] = _join(plan.parts, "h", values)
    return fill_template("common.h", values), _join(["common", *plan.parts], "c", values)


def make_constants(plan: LibraryPlan, prefix: str) -> dict[str, bytes]:
    """Return the name of each constant of the object -> its bytes [-]."""
    places = b"".join(one.to_bytes(8, "little") for one in plan.image.relocations)
    return {f"{prefix}_model": b"".join(plan.image.split_content()), f"{prefix}_relocations": places}


def _join(parts: Sequence[str], ending: str, values: Mapping[str, str]) -> str:
    """The templates of the parts that have one with this ending, filled, one after the other."""
    folder = resources.files("flexinv.export") / "templates"
    there = [part for part in parts if (folder / f"{part}.{ending}.in").is_file()]
    return "".join(fill_template(f"{part}.{ending}", values) for part in there)


def fill_template(template: str, values: Mapping[str, str]) -> str:
    """Return a template with its values [-]."""
    folder = resources.files("flexinv.export") / "templates"
    return Template((folder / f"{template}.in").read_text(encoding="utf-8")).substitute(values)


def _collect_values(plan: LibraryPlan, prefix: str, targets: Sequence[str]) -> dict[str, str]:
    """Name in the templates -> text."""
    m = plan.mechanism
    content = plan.image.write_content()
    head, tail = plan.image.split_content()
    start = m.neutral if plan.start is None else plan.start
    values = {
        "name": prefix, "NAME": prefix.upper(), "title": format_comment(m.name), "markdown_title": format_markdown(m.name),
        "version": flexinv.__version__, "layout": str(LAYOUT), "size": str(plan.image.size), "alignment": str(ALIGNMENT),
        "nq": str(m.nq), "nv": str(m.nv), "head": str(len(head)), "tail": str(len(tail)),
        "at_tail": str(plan.image.zeros[1]), "relocations": str(len(plan.image.relocations)),
        "mark": "0x" + sha256(content).hexdigest()[:16], "target": targets[0], "targets": ", ".join(targets),
        "kernels": "\n".join(f"int32_t {one.call.name}(char *block);" for one in plan.entries),
        "gravity": ", ".join(f"{one:g}" for one in m.gravity), "start": format_numbers(start),
        "start_decimal": ", ".join(f"{one:.9g}" for one in start), "step": repr(plan.step),
        "call": f"{prefix}_{'torque' if plan.kind == 'rigid' else 'step'}", "has_phases": str(int("phases" in plan.parts)),
    }  # fmt: skip
    return (
        values
        | _describe_names(m, prefix)
        | _describe_statuses(prefix)
        | ({} if plan.golden is None else _format_series(plan.golden))
        | dict(plan.values)
    )


def _describe_names(mechanism: Mechanism, prefix: str) -> dict[str, str]:
    """Coordinates, rates and links as constants, strings and rows of tables."""
    links = [link.name for link in mechanism.links]
    return {
        "coordinates": _list_constants(prefix, "Q", make_words("coordinates", mechanism.coordinate_names)),
        "rates": _list_constants(prefix, "V", make_words("rates", mechanism.velocity_names)),
        "links_enum": _list_constants(prefix, "LINK", make_words("links", links)),
        "coordinate_names": ", ".join(map(format_string, mechanism.coordinate_names)),
        "rate_names": ", ".join(map(format_string, mechanism.velocity_names)),
        "coordinate_rows": "\n".join(_describe_coordinates(mechanism)),
        "rate_rows": "\n".join(_describe_rates(mechanism)),
        "link_count": str(len(links)),
    }


def _format_series(golden: GoldenSeries) -> dict[str, str]:
    """The motion and the efforts of the self-test."""
    series = {"q": golden.q, "qd": golden.qd, "qdd": golden.qdd, "tau": golden.tau}
    texts = {f"golden_{name}": format_numbers(numbers.ravel()) for name, numbers in series.items()}
    texts |= {"samples": str(len(golden.q)), "tolerance": repr(golden.tolerance)}
    return texts | {"golden_phase": ", ".join(map(str, golden.phase)) or "0"}


def _list_constants(prefix: str, kind: str, words: Mapping[str, str]) -> str:
    """Members of an enumeration, one for each name."""
    return ",\n".join(f"    {prefix.upper()}_{kind}_{word} = {i}" for i, word in enumerate(words.values()))


def _describe_statuses(prefix: str) -> dict[str, str]:
    name = prefix.upper()
    lines = [f"    {name}_{word} = {i}" for i, word in enumerate(STATUSES)]
    words = [f"    case {name}_{word}: return {format_string(said)};" for word, said in STATUSES.items()]
    rows = [f"| {i} | `{name}_{word}` | {said} |" for i, (word, said) in enumerate(STATUSES.items())]
    return {"statuses": ",\n".join(lines), "status_words": "\n".join(words), "status_rows": "\n".join(rows)}


def _describe_coordinates(mechanism: Mechanism) -> Iterator[str]:
    """Rows of a table: a coordinate of a joint with as many rates is its rate's integral; others are parts of rotations."""
    slides = list_sliding_coordinates(mechanism)
    for joint in mechanism.joints:
        places = mechanism.q_slices[joint.name]
        rates = mechanism.v_slices[joint.name]
        for k, i in enumerate(range(places.start, places.stop)):
            moves = joint.nq == joint.nv or (joint.nq > 4 and k < 3)
            unit = ("m" if slides[rates.start + k] else "rad") if moves else "-"
            yield f"| {i} | {format_markdown(mechanism.coordinate_names[i])} | {unit} |"


def _describe_rates(mechanism: Mechanism) -> Iterator[str]:
    slides = list_sliding_coordinates(mechanism)
    for i, name in enumerate(mechanism.velocity_names):
        yield f"| {i} | {format_markdown(name)} | {'N' if slides[i] else 'N m'} |"
