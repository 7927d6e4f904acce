"""Campaign: faults planted in descriptions by `description_faults`, and what `crosscheck compare` names.

python tests/shared/description_campaign.py --count 200 --seed 1
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import SubElement, fromstring, parse, tostring

from description_faults import Fault, Unfit, plant

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.result import Comparison
from flexinv.errors import InputError
from flexinv.files.from_urdf import find_robots_folder

SIZE = 0.02  # relative: how well a size has to be told
ROBOTS = (
    "panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf", "talos_data/robots/talos_arm.urdf",
    "kinova_description/robots/kinova.urdf", "iiwa_description/urdf/iiwa14.urdf", "solo_description/robots/solo12.urdf",
    "anymal_c_simple_description/urdf/anymal.urdf", "tiago_description/robots/tiago.urdf", "talos_data/robots/talos_full_v2.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
)  # fmt: skip

ARMS = ("ur5_robot.urdf", "z1.urdf", "xarm7.urdf", "talos_left_arm.urdf", "kinova.urdf", "solo12.urdf")


@dataclass(frozen=True)
class Trial:
    """One planted file: the faults, and of them those that were named first, of the right size; others: named for nothing."""

    robot: str
    faults: list[Fault]
    named: list[bool]
    others: list[str]
    words: str = ""

    @property
    def good(self) -> bool:
        return all(self.named)


def fits(fault: Fault, difference: Difference) -> bool:
    """Return True if a difference names the fault: quantity, element, size."""
    places = {fault.element, *fault.also}
    words = set(difference.place.replace(",", " ").split())
    same = difference.cause == fault.quantity or difference.cause in fault.also
    return same and bool(places & words) and abs(difference.size - fault.size) <= SIZE * fault.size + 1e-12


def tried(file: Path, original: Path, faults: list[Fault]) -> Trial:
    """Compare an original with its faulty copy."""
    try:
        comparison = compare(original, file)
    except InputError as error:
        return Trial(original.name, faults, [False] * len(faults), [], str(error))
    return judged(original.name, comparison, faults)


def judged(robot: str, comparison: Comparison, faults: list[Fault]) -> Trial:
    """Return which faults are among the first differences named, and what else is named."""
    every = [*comparison.judged.causes, *comparison.judged.conventions, *comparison.judged.limits]
    unseen = [*comparison.judged.unseen]
    first = [*every[: len(faults)], *([] if len(every) >= len(faults) else unseen)]
    named = [any(fits(fault, d) for d in first) for fault in faults]
    others = [d.words for d in every if not any(fits(fault, d) for fault in faults)]
    return Trial(robot, faults, named, others, comparison.sentence)


def campaign(count: int, seed: int, at_once: int = 1, robots: tuple[str, ...] = ROBOTS) -> Iterator[Trial]:
    """Yield trials of faults in URDFs, drawn from a seed."""
    made = draw = 0
    with tempfile.TemporaryDirectory() as folder:
        while made < count:
            draw += 1
            original = find_robots_folder() / robots[draw % len(robots)]
            try:
                text, faults = plant(original.read_text(), seed * 100000 + draw, at_once)
            except (Unfit, FileNotFoundError):
                continue
            file = Path(folder) / original.name
            file.write_text(text)
            made += 1
            yield tried(file, original, faults)


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")


def across(count: int, seed: int, robots: tuple[str, ...] = ARMS) -> Iterator[Trial]:
    """Yield trials of faults in MJCFs, compared with the URDF that MuJoCo wrote them from, all digits kept."""
    import mujoco

    with tempfile.TemporaryDirectory() as folder:
        made = draw = 0
        while made < count:
            draw += 1
            original = next(find_robots_folder().rglob(robots[draw % len(robots)]))
            spec = mujoco.MjSpec.from_string(geometry_free(original))
            spec.compiler.fusestatic = False
            spec.compile()
            geared, text = with_transmissions(original, folder), with_motors(spec.to_xml())
            try:
                text, faults = plant(text, seed * 100000 + draw)
            except Unfit:
                continue
            file = Path(folder) / f"{original.stem}.xml"
            file.write_text(text)
            made += 1
            yield tried(file, geared, faults)


def with_motors(text: str) -> str:
    """An MJCF whose joints all have a motor, of gear 50."""
    root = fromstring(text)
    motors = SubElement(root, "actuator")
    for joint in root.iter("joint"):
        if joint.get("name") and joint.get("type", "hinge") in ("hinge", "slide"):
            SubElement(motors, "motor", joint=joint.get("name", ""), gear="50")
    return tostring(root, encoding="unicode")


def with_transmissions(original: Path, folder: str) -> Path:
    """A copy of a URDF whose joints all have a simple transmission, of reduction 50."""
    root = parse(original).getroot()
    for one in root.findall("transmission"):
        root.remove(one)
    for joint in root.findall("joint"):
        part = SubElement(root, "transmission", name=f"of {joint.get('name')}")
        SubElement(part, "type").text = "transmission_interface/SimpleTransmission"
        SubElement(SubElement(part, "joint", name=joint.get("name", "")), "mechanicalReduction").text = "50"
    file = Path(folder) / original.name
    file.write_text(tostring(root, encoding="unicode"))
    return file


def geometry_free(file: Path) -> str:
    """Return the text of a URDF without shapes, mimic joints and their files."""
    root = parse(file).getroot()
    for part in root:
        for shape in [p for p in part if p.tag in ("visual", "collision", "mimic")]:
            part.remove(shape)
    return tostring(root, encoding="unicode")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--across", action="store_true", help="faults in MJCF, against the URDF")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    trials, kinds = [], Counter[tuple[str, bool]]()
    chosen = across(given.count, given.seed) if given.across else campaign(given.count, given.seed, given.at_once)
    for trial in chosen:
        trials.append(trial)
        for fault, named in zip(trial.faults, trial.named, strict=True):
            kinds[fault.kind, named] += 1
        if not trial.good or trial.others:
            say(trial.robot, [vars(f) for f in trial.faults], trial.named, trial.others[:4], trial.words[:200])
    good, false = sum(t.good for t in trials), sum(bool(t.others) for t in trials)
    say(f"named first with their sizes: {good} of {len(trials)}; with a false name beside: {false}")
    for kind in sorted({k for k, _ in kinds}):
        say(f"  {kind}: {kinds[kind, True]} named, {kinds[kind, False]} not")
    if given.out:
        rows = [
            {"robot": t.robot, "faults": [vars(f) for f in t.faults], "named": t.named, "others": t.others}
            for t in trials
        ]
        given.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
