"""Campaign: files of several formats and origins that should be one robot: equal, or repaired by named differences.

The files of others stay where they are: in installed packages, or in unpacked wheels that are given.  What is not there is said.

python tests/shared/sibling_campaign.py --folder robosuite=UNPACKED --folder genesis=UNPACKED
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.result import REPAIRED, Comparison
from flexinv.errors import InputError
from flexinv.files.from_urdf import find_robots_folder

DATA, ROBOSUITE, BULLET = "data", "robosuite/models/assets/robots", "robosuite/models/assets/bullet_data"
GENESIS = "genesis/assets"
PANDA, PANDA_XML = f"{DATA}/panda_description/urdf/panda.urdf", f"{GENESIS}/xml/franka_emika_panda/panda.xml"
IIWA_XML = f"{ROBOSUITE}/iiwa/robot.xml"
BULLET_PANDA, BULLET_IIWA = f"{GENESIS}/urdf/panda_bullet", f"{GENESIS}/urdf/kuka_iiwa"
ANYMAL = f"{DATA}/anymal_b_simple_description/robots"
TALOS, UR, DRONES = f"{DATA}/talos_data/robots", f"{DATA}/ur_description/urdf", f"{GENESIS}/urdf/drones"


@dataclass(frozen=True)
class Pair:
    """Two files of one robot; stated: joints that names and structure leave open."""

    a: str
    b: str
    stated: Mapping[str, str] = field(default_factory=dict)


PAIRS = (
    Pair(PANDA, PANDA_XML),
    Pair(PANDA, f"{ROBOSUITE}/panda/robot.xml"),
    Pair(PANDA, f"{BULLET_PANDA}/panda.urdf"),
    Pair(PANDA, f"{BULLET}/panda_description/urdf/panda_arm_hand.urdf"),
    Pair(PANDA, f"{DATA}/panda_description/urdf/panda_collision.urdf"),
    Pair(PANDA_XML, f"{ROBOSUITE}/panda/robot.xml"),
    Pair(PANDA_XML, f"{BULLET_PANDA}/panda.urdf"),
    Pair(PANDA_XML, f"{GENESIS}/xml/franka_emika_panda/panda_nohand.xml"),
    Pair(PANDA_XML, f"{GENESIS}/xml/franka_emika_panda/panda_no_tendon.xml"),
    Pair(PANDA_XML, f"{GENESIS}/xml/franka_sim/franka_panda.xml"),
    Pair(f"{BULLET_PANDA}/panda.urdf", f"{BULLET_PANDA}/panda_nohand.urdf"),
    Pair(f"{BULLET_PANDA}/panda_nohand.urdf", f"{BULLET}/panda_description/urdf/panda_arm.urdf"),
    Pair(f"{BULLET_IIWA}/model.urdf", IIWA_XML),
    Pair(f"{BULLET_IIWA}/model.urdf", f"{BULLET_IIWA}/model.sdf"),
    Pair(f"{BULLET_IIWA}/model.urdf", f"{BULLET_IIWA}/model_vr_limits.urdf"),
    Pair(f"{BULLET_IIWA}/model.urdf", f"{BULLET_IIWA}/model_for_sdf.urdf"),
    Pair(f"{GENESIS}/xml/universal_robots_ur5e/ur5e.xml", f"{ROBOSUITE}/ur5e/robot.xml"),
    Pair(f"{UR}/ur5_robot.urdf", f"{GENESIS}/xml/universal_robots_ur5e/ur5e.xml"),
    Pair(f"{UR}/ur5_robot.urdf", f"{UR}/ur5_gripper.urdf"),
    Pair(f"{UR}/ur10_robot.urdf", f"{UR}/ur10_joint_limited_robot.urdf"),
    Pair(f"{DATA}/baxter_description/urdf/baxter.urdf", f"{ROBOSUITE}/baxter/robot.xml"),
    Pair(f"{DATA}/baxter_description/urdf/baxter.urdf", f"{BULLET}/baxter_description/urdf/baxter_arm.urdf"),
    Pair(f"{ROBOSUITE}/sawyer/robot.xml", f"{BULLET}/sawyer_description/urdf/sawyer_arm.urdf"),
    Pair(f"{DATA}/xarm_description/urdf/xarm7.urdf", f"{ROBOSUITE}/xarm7/robot.xml"),
    Pair(f"{DATA}/go2_description/urdf/go2.urdf", f"{GENESIS}/urdf/go2/urdf/go2.urdf"),
    Pair(f"{DATA}/anymal_c_simple_description/urdf/anymal.urdf", f"{GENESIS}/urdf/anymal_c/urdf/anymal_c.urdf"),
    Pair(f"{ANYMAL}/anymal.urdf", f"{ANYMAL}/anymal-kinova.urdf"),
    Pair(f"{DATA}/tiago_description/robots/tiago_no_hand.urdf", f"{ROBOSUITE}/tiago/robot.xml"),
    Pair(f"{TALOS}/talos_full_v2.urdf", f"{TALOS}/talos_reduced.urdf"),
    Pair(f"{TALOS}/talos_reduced.urdf", f"{TALOS}/talos_reduced_corrected.urdf"),
    Pair(f"{DATA}/b1_description/urdf/b1.urdf", f"{DATA}/b1_description/urdf/b1-z1.urdf"),
    Pair(f"{DATA}/g1_description/urdf/g1_29dof_rev_1_0.urdf", f"{DATA}/g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf"),
    Pair(f"{DATA}/romeo_description/urdf/romeo.urdf", f"{DATA}/romeo_description/urdf/romeo_small.urdf"),
    Pair(f"{DATA}/simple_humanoid_description/urdf/simple_humanoid.urdf",
         f"{DATA}/simple_humanoid_description/urdf/simple_humanoid_classical.urdf"),
    Pair(f"{DRONES}/cf2x.urdf", f"{DRONES}/cf2p.urdf"),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What came of a pair: the comparison, or the words of why there is none; absent: a file is not on this machine."""

    pair: Pair
    found: Comparison | None
    words: str
    seconds: float
    absent: bool = False

    @property
    def good(self) -> bool:
        """Equal, or different by named differences that repair leaves nothing of."""
        return self.found is not None and self.found.judged.after <= REPAIRED


def folders(given: Iterable[str]) -> dict[str, Path]:
    """The folder that holds each package: as given, else where it is installed."""
    result = {DATA: find_robots_folder().parent}
    stated = dict(one.split("=", 1) for one in given)
    for name in ("robosuite", "genesis"):
        spec = importlib.util.find_spec(name) if name not in stated else None
        if name in stated:
            result[name] = Path(stated[name])
        elif spec is not None and spec.submodule_search_locations:
            result[name] = Path(spec.submodule_search_locations[0]).parent
    return result


def located(name: str, known: Mapping[str, Path]) -> Path | None:
    package, _, rest = name.partition("/")
    if package not in known:
        return None
    path = find_robots_folder() / rest if package == DATA else known[package] / name
    return path if path.is_file() else None


def outcomes(pairs: Iterable[Pair], known: Mapping[str, Path]) -> Iterator[Outcome]:
    """Yield what comes of each pair."""
    for pair in pairs:
        paths = [located(name, known) for name in (pair.a, pair.b)]
        begun = time.perf_counter()
        if paths[0] is None or paths[1] is None:
            lost = [name for name, path in zip((pair.a, pair.b), paths, strict=True) if path is None]
            yield Outcome(pair, None, f"not on this machine: {', '.join(lost)}", 0.0, absent=True)
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                comparison: Comparison | None = compare(paths[0], paths[1], match=pair.stated)
            words = "equal" if comparison is not None and comparison.equal else "different"
        except InputError as error:
            comparison, words = None, f"cannot: {' '.join(str(error).split())[:400]}"
        yield Outcome(pair, comparison, words, time.perf_counter() - begun)


def line(one: Outcome) -> str:
    """A row of the table: files, verdict, numbers of named differences, what repair leaves, joints matched, time."""
    names = " | ".join("/".join(Path(name).parts[-2:]) for name in (one.pair.a, one.pair.b))
    if one.found is None:
        return f"| {names} | {one.words} | | | | |"
    judged = one.found.judged
    counts = f"{len(judged.causes)} + {len(judged.conventions)} + {len(judged.limits)}"
    return f"| {names} | {one.words} | {counts} | {judged.after:.1e} | {one.found.matched} | {one.seconds:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", action="append", default=[], metavar="PACKAGE=FOLDER")
    given = parser.parse_args()
    done = []
    sys.stdout.write(
        "| A | B | result | causes + conventions + limits | repair leaves | joints | s |\n|---|---|---|--:|--:|---|--:|\n"
    )
    for one in outcomes(PAIRS, folders(given.folder)):
        done.append(one)
        sys.stdout.write(line(one) + "\n")
        sys.stdout.flush()
    there = [one for one in done if not one.absent]
    good = sum(one.good for one in there)
    sys.stdout.write(
        f"\n{good} of {len(there)} pairs equal, or repaired to {REPAIRED:g}; {len(done) - len(there)} not on this machine\n"
    )


if __name__ == "__main__":
    main()
