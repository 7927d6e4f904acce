"""lint: one description alone, and what in it no machine can have, or what its readers make different things of."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from crosscheck.equivalence.sources import describe, find_format, is_xml
from crosscheck.findings.bodies import check_bodies
from crosscheck.findings.finding import Finding, FindingEntry, make_error, make_warning
from crosscheck.findings.sides import check_sides
from crosscheck.findings.statements import LinkStatements, Mounting
from crosscheck.lifting.description import Description
from crosscheck.lifting.rigid import join_bodies
from crosscheck.linting.numbers import check_broken_lines
from crosscheck.linting.parts import check_parts
from crosscheck.linting.urdf import check_urdf
from flexinv.errors import InputError
from flexinv.files.from_urdf import list_xml_repairs, read_xml
from flexinv.model.mechanism import Joint
from flexinv.validation import check_flag

LAWS = ("coupling-law", "tendon-equality", "equality")  # features that tie joints by more than a linear law


class LintEntry(TypedDict):
    """A report as JSON values."""

    format: str
    file: str
    clean: bool
    findings: list[FindingEntry]


@dataclass(frozen=True)
class LintReport:
    """Findings of one description; strict : warnings count, too; refused : why it cannot be read at all, "" if it can."""

    label: str
    findings: tuple[Finding, ...]
    strict: bool = False
    refused: str = ""

    @property
    def clean(self) -> bool:
        """Return True if nothing that counts was found."""
        return not any(finding.level == "error" or self.strict for finding in self.findings)

    @property
    def words(self) -> str:
        """Return the numbers of errors and warnings in words."""
        errors = sum(one.level == "error" for one in self.findings)
        return f"errors: {errors}, warnings: {len(self.findings) - errors}" if self.findings else "nothing found"

    @property
    def plain(self) -> LintEntry:
        """Return the findings as JSON values."""
        return {
            "format": "crosscheck-lint/1",
            "file": self.label,
            "clean": self.clean,
            "findings": [f.plain for f in self.findings],
        }


def lint(source: Any, strict: bool = False, meshes: bool = True) -> LintReport:
    """List the suspicious parts of a description, as `compare` takes it.

    strict : warnings count; meshes : look at the shapes of a URDF's links, too, where trimesh is installed

    Raises InputError for what cannot be read at all.
    """
    strict = check_flag("strict", strict)
    meshes = check_flag("meshes", meshes)
    path = Path(source) if isinstance(source, str | Path) else None
    if path is not None and os.path.isfile(path) and is_xml(path) and find_format(path) == "urdf":
        robot = read_xml(path)  # a regular file, of a size that is read
        written = path.read_text(encoding="utf-8", errors="replace")
        found = [*_check_xml(path), *check_broken_lines(written), *check_urdf(robot, path, meshes)]
        if not any(one.level == "error" for one in found):
            found += _check_readable(path)
        return LintReport(path.name, _join_findings(found), strict)
    description = describe(source)
    repaired = _check_xml(path) if path is not None and os.path.isfile(path) and is_xml(path) else []
    found = [*repaired, *check_machine(description), *check_parts(description.mechanism)]
    return LintReport(description.label, _join_findings(found), strict)


def check_sources(
    sources: Iterable[Any],
    strict: bool = False,
    meshes: bool = True,
    way: Callable[[Any, bool, bool], LintReport] = lint,
) -> list[LintReport]:
    """List the findings of several descriptions; one that cannot be read is a finding of its own, and keeps none back.

    strict, meshes : of `lint`; way : to lint one of them, such as in a process of its own
    """
    result = []
    for source in sources:
        try:
            result.append(way(source, strict, meshes))
        except InputError as problem:
            words = str(problem)
            name = Path(str(source)).name
            finding = make_error("file", name, " ".join(words.split()), "it cannot be read", "as it says")
            result.append(LintReport(name, (finding,), strict, words))
    return result


def _check_xml(path: Path) -> Iterator[Finding]:
    """Yield what the standard of XML forbids and some readers take."""
    for words in list_xml_repairs(path):
        write = "one hyphen in comments" if "comment" in words else "the declaration in the first tag"
        why = "XML forbids it: MuJoCo, DART and urdfdom read it, strict readers refuse the file"
        yield make_warning("xml", path.name, words, why, write)


def _check_readable(path: Path) -> Iterator[Finding]:
    """Yield the reason why a URDF without errors of its own is not read."""
    try:
        describe(path)
    except InputError as problem:
        yield make_error(
            "file", path.name, " ".join(str(problem).split()), "this project's reader refuses it", "as it says"
        )


def _join_findings(found: list[Finding]) -> tuple[Finding, ...]:
    """Errors first; findings that say the same of several links or joints are one."""
    groups: dict[tuple[str, ...], list[Finding]] = {}
    for one in found:
        groups.setdefault((one.check, one.level, one.given, one.why, one.write, one.place.split()[0]), []).append(one)
    return tuple(sorted(map(_join_places, groups.values()), key=lambda one: one.level))


def _join_places(same: list[Finding]) -> Finding:
    places = list(dict.fromkeys(one.place for one in same))
    if len(places) == 1:
        return same[0]
    names = ", ".join(place.partition(" ")[2] for place in places[:6]) + (" ..." if len(places) > 6 else "")
    return replace(same[0], place=f"{places[0].partition(' ')[0]}s {names} ({len(places)})")


def check_machine(description: Description) -> Iterator[Finding]:
    """Yield findings of a mechanism, whatever it was lifted from [m, kg, rad]."""
    mechanism = description.mechanism
    moving = {joint.child for joint in mechanism.joints if joint.nv}
    links = {}
    for link in mechanism.links:
        body = join_bodies([part.inertia for part in link.bodies])
        links[link.name] = LinkStatements(link.name, body, link.name in moving, bool(link.bodies))
    lengths = sorted(float(np.linalg.norm(joint.placement.position)) for joint in mechanism.joints)
    mountings = [
        Mounting(joint.parent, joint.child, joint.placement) for joint in mechanism.joints if joint.station is None
    ]
    yield from check_bodies(links, float(sum(lengths[-6:])) or 1.0)
    yield from check_sides(links, mountings)
    for joint in mechanism.joints:
        yield from _check_limits(joint)
    yield from _check_shape_masses(description)
    yield from _check_left_out(description)


def _check_limits(joint: Joint) -> Iterator[Finding]:
    low = joint.limits.lower
    high = joint.limits.upper
    place = f"joint {joint.name}"
    given = f"{low:g} to {high:g}"
    if low > high:
        yield make_error("limit", place, given, "lower is above upper", "the two exchanged")
    elif joint.kind == "revolute" and np.isfinite(high) and 4 * np.pi < max(-low, high) < 1e4:
        yield make_warning("units", place, given, "beyond two turns: looks like degrees", "radians")


def _check_shape_masses(description: Description) -> Iterator[Finding]:
    """Yield links without ``<inertial>`` that weigh something else in MuJoCo and in Pinocchio [kg]."""
    for link, masses in description.shape_masses.items():
        given = f"no <inertial>; its shapes weigh {masses.weighed:.4g} kg, those that collide {masses.colliding:.4g} kg"
        low, high = masses.groups
        why = (
            f"MuJoCo weighs the shapes of groups {low} to {high}, also those that are only seen; Pinocchio those that collide, "
            "of all groups, a mesh as 1 kg"
        )
        yield make_warning("mass of shapes", f"link {link}", given, why, "<inertial>, which all readers take alike")


def _check_left_out(description: Description) -> Iterator[Finding]:
    """Yield laws that a mechanism does not have, and what was dropped of a file, where readers differ or shapes are lost."""
    label = description.label
    files = {Path(link.part.source).name: link.name for link in description.mechanism.links if link.part is not None}
    for feature in description.features:
        if feature.name in LAWS:
            yield _make_doubt(label, f"{feature.name} of {feature.place}: {feature.words}")
    for words in description.dropped:
        if words.startswith("geometry"):
            yield make_warning("file", label, words, "shapes of it are not there", "the file where it is named")
        if words.partition(": ")[0] in files:
            why = "the mesh is read in another way than it is written"
            yield make_warning("mesh file", f"link {files[words.partition(': ')[0]]}", words, why, "a file without it")
        if words.startswith(("equality", "mimic", "transmission")):
            yield _make_doubt(label, words)


def _make_doubt(label: str, words: str) -> Finding:
    why = "readers make different things of it"
    return make_warning("dropped", label, words, why, "compare with --readers all")
