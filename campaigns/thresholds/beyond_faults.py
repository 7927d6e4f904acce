"""Faults of `campaigns.beyond` for thresholds: harmed engines are run and compared once, causes are asked for with each change.

They are users' mistakes with bodies, drives, places, loops and signals, two at once among them, drawn by a fixed seed; only those
that make a run ask for causes are of use here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from campaigns.beyond.campaign import LOOPS, OWN, RIGID, Bench
from campaigns.beyond.catalogue import draw, make_fault
from campaigns.beyond.fault import Fault
from campaigns.beyond.judge import BAD, GOOD
from campaigns.beyond.planting import apply_fault
from campaigns.beyond.trial import HarmedRun, TrialLocation, ask_for_causes, prepare, run_harmed_engine
from campaigns.thresholds.verdict import Verdict
from crosscheck.causes.fit import Columns

MODELS = Path(__file__).resolve().parents[2] / "models"
# Of the benches of `campaigns.beyond` those that answer within seconds: none that marches.
BENCHES = (
    Bench("double_pendulum", "swing", RIGID),
    Bench("rigid_3r", "quintic", RIGID),
    Bench("elastic_drives", "swing", RIGID, 1.5),
    Bench("four_bar", "turn", LOOPS),
    Bench("slider_crank", "turns", LOOPS),
    Bench("five_bar", "reach", LOOPS),
    Bench("rigid_one_link", "cycloid", RIGID),
    Bench("service_arm", "reach", ("pinocchio", "mujoco"), in_package=True),
)
DRAWN = 64  # of which some are silent, or refused
SEED = 36


@dataclass(frozen=True)
class KnownFault:
    """A fault of a number in an engine, and what the run of the harmed engine said."""

    number: int
    place: TrialLocation
    fault: Fault
    run: HarmedRun


@cache
def open_folder() -> TemporaryDirectory[str]:
    """Return the folder of all records, which is there as long as the program."""
    return TemporaryDirectory()


@cache
def prepare_faults() -> tuple[KnownFault, ...]:
    """Return the faults that make a run ask for causes, once run."""
    folder = Path(open_folder().name)
    scenes = [(bench, engine) for bench in BENCHES for engine in bench.engines]
    places = [_make_place(bench, engine, folder) for bench, engine in scenes]
    references = {place.mechanism: replace(place, engine="flexinv") for place in places}
    prepare([asdict(place) for place in (*references.values(), *places)])
    weights = [bench.weight / len(bench.engines) for bench, _ in scenes]
    scenarios = [place.read_setup() for place in places]
    found = []
    for drawn in draw(scenarios, weights, DRAWN, SEED):
        place = places[drawn.scene]
        fault = make_fault(drawn, scenarios[drawn.scene])
        assert fault is not None  # it is drawn where it can be made
        with apply_fault(fault, place.engine):
            run = run_harmed_engine(place, scenarios[drawn.scene], fault, folder / f"fault{drawn.number}")
        if isinstance(run, HarmedRun) and run.questions:
            found.append(KnownFault(drawn.number, place, fault, run))
    return tuple(found)


def _make_place(bench: Bench, engine: str, folder: Path) -> TrialLocation:
    models = OWN if bench.in_package else MODELS
    return TrialLocation(str(models), bench.mechanism, bench.case, engine, str(folder / "unharmed"))


def list_beyond_verdicts() -> Iterator[Verdict]:
    """Yield what each of the faults is called [-]."""
    columns: dict[tuple[str, str], Columns] = defaultdict(Columns)
    for known in prepare_faults():
        yield ask_about(known, columns[known.place.mechanism, known.place.case])


def ask_about(known: KnownFault, columns: Columns) -> Verdict:
    """Return what a fault is called; columns : of the causes of its mechanism."""
    with apply_fault(known.fault, known.place.engine):
        row = ask_for_causes(known.run, columns)
    outcome = row["outcome"]
    counted = "right" if outcome in GOOD else "wrong" if outcome in BAD else "not named"
    return Verdict(counted, tuple(f"{one['cause']} of {one['target']}" for one in row["named"]))
