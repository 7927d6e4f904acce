"""Campaign: every robot file below some folders is lifted, and held against its reader's own dynamics by an independent judge.

    python campaigns/lifted_files.py                             # files of installed packages, and this project's own
    python campaigns/lifted_files.py FOLDER ... --keep rows.jsonl  # files below folders; rows that are there are not done twice
    python campaigns/lifted_files.py FOLDER --readers mujoco,pinocchio   # other readers of the same files, too

Every file has a process of its own with a limit of time: one that ends, or does not end, is a row.  Outcomes:

    right             the reader's own efforts are those of the lifted mechanism, to 1e-9 of the range (single precision: 1e-5)
    named             they differ, by parts that the description names, and by nothing else
    not comparable    they differ, or nobody answers, and the description's own proof says so
    refused           an error in words
    not judged        no independent judge could be asked, and why; what the project's own proof says is in the row
    doubted           the project's own proof says that they differ, and the judge finds that they do not
    WRONG             said to be right, and differs
    BROKEN            an exception that is no InputError, a process that ended, or one that took too long

Exit code 1 where a row is WRONG, BROKEN or doubted.  The seed is fixed: the same files give the same rows.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from campaigns.lifted_judges import (  # noqa: E402
    Judgement,
    NoJudge,
    States,
    draw_states,
    judge_by_mujoco,
    judge_by_newton,
)
from campaigns.lifted_judges_of_trees import judge_by_drake, judge_by_pinocchio  # noqa: E402
from crosscheck.equivalence.proof import LOST, PROVEN, SOURCE, UNPROVEN, prove  # noqa: E402
from crosscheck.equivalence.proving.provers import add_dynamics  # noqa: E402
from crosscheck.equivalence.sources import describe, find_format, is_xml  # noqa: E402
from crosscheck.lifting.description import Description  # noqa: E402
from flexinv.errors import InputError  # noqa: E402
from flexinv.files.from_urdf import find_robots_folder  # noqa: E402
from flexinv.model.mechanism import Mechanism  # noqa: E402
from flexinv.rigid.joint_torques import joint_torques  # noqa: E402
from flexinv.typing import Array  # noqa: E402

RIGHT, NAMED, INCOMPARABLE, REFUSED, UNJUDGED = "right", "named", "not comparable", "refused", "not judged"
DOUBTED, WRONG, BROKEN = "doubted", "WRONG", "BROKEN"
OUTCOMES = (RIGHT, NAMED, INCOMPARABLE, REFUSED, UNJUDGED, DOUBTED, WRONG, BROKEN)
BAD = (DOUBTED, WRONG, BROKEN)
SUFFIXES = (".urdf", ".xml", ".mjcf", ".sdf", ".world", ".usd", ".usda", ".usdc")
HELD, SINGLE = 1e-9, 1e-5  # of the range of a joint's effort
# Rounding of both sums: some ten operations with numbers as large as the tree's largest effort.
ROUNDING = 1e-14
PATIENCE = 180.0  # [s] for one file
JUDGES = {
    ("mjcf", ""): judge_by_mujoco, ("urdf", ""): judge_by_pinocchio, ("sdf", ""): judge_by_drake,
    ("usd", ""): judge_by_newton,
    ("urdf", "mujoco"): judge_by_mujoco, ("urdf", "pinocchio"): judge_by_pinocchio,
    ("urdf", "drake"): judge_by_drake, ("mjcf", "drake"): judge_by_drake,
}  # fmt: skip
HELD_BY = {"mjcf": "mujoco", "urdf": "pinocchio", "sdf": "drake"}


@dataclass(frozen=True)
class Row:
    """What came of one file.

    file : its path; reader : "" for the reader of its format; size : largest difference over the range of the joint's effort [-]
    joint : where that is; words : what is named, or why it is refused; proof : what the project's own proof says
    """

    file: str
    reader: str
    outcome: str
    joint: str = ""
    size: float = 0.0
    words: str = ""
    proof: str = ""


def find_files(folders: Iterable[Path]) -> Iterator[tuple[Path, Path]]:
    """Yield folder and path of every robot file below some folders, each content once."""
    seen: set[bytes] = set()
    for folder in folders:
        for path in sorted(folder.rglob("*")) if folder.is_dir() else [folder]:
            if path.suffix.lower() not in SUFFIXES or not path.is_file() or not _holds_robot(path):
                continue
            # What a file includes lies beside it: the same text in another folder is another robot.
            key = hashlib.sha256(str(path.parent).encode() + path.read_bytes()).digest()
            if key not in seen:
                seen.add(key)
                yield folder, path


def _holds_robot(path: Path) -> bool:
    """Return True for a file of a robot: XML with one of the roots, or USD that speaks of bodies."""
    content = path.read_bytes()
    if path.suffix.lower().startswith(".usd"):
        return b"PXR-USDC" in content[:8] or b"PhysicsRigidBodyAPI" in content
    return is_xml(path) and any(root in content for root in (b"<robot", b"<mujoco", b"<sdf"))


def judge(path: Path, reader: str = "") -> Row:
    """Lift a file and judge what came out."""
    row = Row(str(path), reader, REFUSED)
    try:
        kind = find_format(path)
        description = add_dynamics(describe(f"{path}@{reader}" if reader else path))
    except InputError as error:
        return replace(row, words=" ".join(str(error).split())[:300])
    proof = prove(description)
    told = f"{proof.state}" + (f": {proof.words}"[:300] if proof.state != PROVEN else "")
    row = replace(row, proof=told)
    mechanism = bare(description.mechanism)
    states = draw_states(mechanism)
    ask = JUDGES.get((kind, "" if reader == HELD_BY.get(kind) else reader))
    try:
        if ask is None:
            raise NoJudge(f"no independent judge of {kind} by {reader or 'its own reader'}")
        if not mechanism.nv:
            return replace(
                row, outcome=RIGHT if proof.state in (PROVEN, SOURCE) else INCOMPARABLE, words="nothing moves"
            )
        judgement = ask(path, mechanism, states)
    except NoJudge as error:
        outcome = INCOMPARABLE if proof.state in (LOST, UNPROVEN) else UNJUDGED
        return replace(row, outcome=outcome, words=str(error))
    return weigh(row, description, proof.state, states, judgement)


def bare(mechanism: Mechanism) -> Mechanism:
    """Return the cut tree of a mechanism without dry friction, which is judged apart [N m]."""
    joints = tuple(replace(joint, friction=0.0) for joint in mechanism.joints)
    return replace(mechanism, joints=joints, closures=(), springs=(), forces=())


def weigh(row: Row, description: Description, proof: str, states: States, judgement: Judgement) -> Row:
    """Return the row with its outcome: the mechanism's efforts beside the reader's own, and what is named between them."""
    mechanism = bare(description.mechanism)
    torques = joint_torques(mechanism, states.q, states.qd, states.qdd, threads=1)
    held = SINGLE if judgement.single or description.precision else HELD
    gap, joint = _largest(mechanism, torques, judgement.efforts, held)
    named = {feature.name for feature in description.features if feature.felt}
    rubbing = [
        name
        for name, value in judgement.friction.items()
        if abs(description.mechanism.joint_of[name].friction - value) > 1e-12 * abs(value)
    ]
    if rubbing and not named & {"free-friction"}:
        gap, joint = max(gap, 1.0), f"{rubbing[0]} (dry friction)"
    row = replace(row, joint=joint, size=gap, words=", ".join(sorted(named)))
    said = proof in (PROVEN, SOURCE)
    if gap <= held:
        return replace(row, outcome=RIGHT if said else DOUBTED if proof == LOST else INCOMPARABLE)
    rest, place = gap, joint
    if judgement.without is not None and not rubbing:
        rest, place = _largest(mechanism, torques, judgement.without, held)
    unnamed = sorted(set(judgement.parts) - named)
    if rest <= held and not unnamed:
        return replace(row, outcome=NAMED if said else DOUBTED if proof == LOST else INCOMPARABLE)
    if not said:
        return replace(row, outcome=INCOMPARABLE)
    words = f"not named: {', '.join(unnamed)}" if unnamed else f"named: {', '.join(sorted(named)) or 'nothing'}"
    return replace(row, outcome=WRONG, joint=place, size=max(rest, gap if unnamed else rest), words=words)


def _largest(mechanism: Mechanism, ours: Array, theirs: Array, held: float) -> tuple[float, str]:
    """The largest difference over the range of an effort [-], and its joint; rounding of sums over the tree is none."""
    whole = float(np.abs(theirs).max(initial=0.0))
    worst, place = 0.0, ""
    for name, own in mechanism.v_slices.items():
        if own.stop == own.start:
            continue
        size = np.maximum(np.abs(ours[:, own]), np.abs(theirs[:, own])).max(axis=0)
        gap = np.abs(ours[:, own] - theirs[:, own]).max(axis=0)
        rounding = (ROUNDING if held == HELD else SINGLE * 1e-2) * whole
        share = np.where(gap <= rounding, 0.0, gap / np.where(size > 0.0, size, 1.0))
        share = np.where(np.isfinite(gap), share, np.inf)
        if share.max() > worst:
            worst, place = float(share.max()), name
    return worst, place


def _answer(pipe: Connection, path: Path, reader: str) -> None:
    """Judge a file in a process of its own, and send the row."""
    warnings.simplefilter("ignore")
    try:
        row = judge(path, reader)
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
        row = Row(str(path), reader, BROKEN, words=" ".join(words.split())[:300])
    pipe.send(asdict(row))
    pipe.close()


def judge_apart(path: Path, reader: str, patience: float = PATIENCE) -> Row:
    """Return the row of a file, judged in a process of its own; one that ends or takes more than ``patience`` [s] is BROKEN."""
    context = multiprocessing.get_context("fork")
    near, far = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(far, path, reader), daemon=True)
    process.start()
    far.close()
    try:
        if near.poll(patience):
            return Row(**near.recv())
        words = f"no answer within {patience:g} s"
    except EOFError:
        process.join(10.0)
        words = f"its process ended with {process.exitcode}"
    finally:
        if process.is_alive():
            process.kill()
        process.join()
        near.close()
    return Row(str(path), reader, BROKEN, words=words)


def default_folders() -> list[Path]:
    """Return the folders of robots of installed packages, and of this project."""
    result = [ROOT / "models", ROOT / "tests"]
    for package, folder in (
        ("mujoco", "testdata"),
        ("pydrake", "share"),
        ("newton", "."),
        ("robosuite", "."),
        ("dm_control", "."),
    ):
        spec = find_spec(package)
        if spec is not None and spec.origin is not None:
            result.append(Path(spec.origin).parent / folder)
    with suppress(InputError):  # it is not installed
        result.append(find_robots_folder())
    return [folder for folder in result if folder.is_dir()]


def kept_rows(keep: Path | None, again: Iterable[str]) -> dict[tuple[str, str], Row]:
    """Return rows of earlier runs by file and reader, but those whose outcome is to be judged again."""
    if keep is None or not keep.is_file():
        return {}
    rows = [Row(**json.loads(line)) for line in keep.read_text().splitlines()]
    return {(row.file, row.reader): row for row in rows if row.outcome not in set(again)}


def show(rows: dict[Path, list[Row]], most: int = 40) -> str:
    """Return counts by folder, then the rows that are bad, and the worst of the rest."""
    lines = ["folder | " + " | ".join(OUTCOMES)]
    whole: Counter[str] = Counter()
    for folder, own in rows.items():
        counted = Counter(row.outcome for row in own)
        whole += counted
        lines.append(f"{folder.name} | " + " | ".join(str(counted[outcome]) for outcome in OUTCOMES))
    lines.append("all | " + " | ".join(str(whole[outcome]) for outcome in OUTCOMES))
    every = [row for own in rows.values() for row in own]
    bad = sorted((row for row in every if row.outcome in BAD), key=lambda row: (row.outcome, -row.size))
    lines += ["", *(line_of(row) for row in bad[:most])]
    if len(bad) > most:
        lines.append(f"... and {len(bad) - most} more")
    right = sorted((row for row in every if row.outcome == RIGHT), key=lambda row: -row.size)
    lines += ["", "largest differences that are right:", *(line_of(row) for row in right[:5])]
    return "\n".join(lines)


def line_of(row: Row) -> str:
    """Return a row in a line [-]."""
    place = f"{row.file}@{row.reader}" if row.reader else row.file
    return f"{row.outcome:14} {place}  {row.joint} {row.size:.2g}  {row.words}  [{row.proof}]"


def main() -> int:
    """Run the campaign; 1 where a row is bad."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--readers", default="", help="other readers of the same files: mujoco,pinocchio,drake")
    parser.add_argument("--keep", type=Path, help="a file of rows that are not judged again")
    parser.add_argument("--again", default="", help="outcomes that are judged again, such as WRONG,BROKEN")
    parser.add_argument("--rows", action="store_true", help="print every row")
    given = parser.parse_args()
    files = list(find_files(given.folders or default_folders()))
    others = [name for name in given.readers.split(",") if name]
    work = [(folder, path, reader) for folder, path in files for reader in ("", *others) if _reads(path, reader)]
    kept = kept_rows(given.keep, given.again.split(","))
    _warm_up()
    rows: dict[Path, list[Row]] = {}
    for count, (folder, path, reader) in enumerate(work, start=1):
        row = kept.get((str(path), reader)) or judge_apart(path, reader)
        if given.keep is not None and (str(path), reader) not in kept:
            with given.keep.open("a") as stream:
                stream.write(json.dumps(asdict(row)) + "\n")
        rows.setdefault(folder, []).append(row)
        if given.rows:
            sys.stdout.write(line_of(row) + "\n")
        sys.stderr.write(f"\r[{'#' * (30 * count // len(work)):30}] {count}/{len(work)} {path.name[:40]:40}")
        sys.stderr.flush()
    sys.stderr.write("\n")
    sys.stdout.write(show(rows) + "\n")
    return int(any(row.outcome in BAD for own in rows.values() for row in own))


def _reads(path: Path, reader: str) -> bool:
    """Return True if a reader is asked for a file: its own is always."""
    try:
        return not reader or (find_format(path), reader) in JUDGES
    except InputError:
        return False


def _warm_up() -> None:
    """Load once what every process needs."""
    import crosscheck.engines.mujoco.lift
    import crosscheck.engines.pinocchio.lift  # noqa: F401
    from flexinv.files.load_mechanism import load_mechanism

    mechanism = load_mechanism(ROOT / "models" / "rigid_3r" / "mechanism.toml")
    none = np.zeros((1, mechanism.nv))
    joint_torques(mechanism, mechanism.neutral[None], none, none, threads=1)


if __name__ == "__main__":
    sys.exit(main())
