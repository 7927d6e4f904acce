"""Campaigns: which mechanisms and engines, how many faults, from which seed; run in processes, written down, summed up."""

from __future__ import annotations

import functools
import json
import threading
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from campaigns.beyond.catalogue import DrawnFault, draw
from campaigns.beyond.judge import compute_shares, is_new
from campaigns.beyond.trial import TrialLocation
from crosscheck.checkout import ROOT
from crosscheck.engines import ENGINES, describe_missing_package
from crosscheck.measures.limits import REFERENCE
from crosscheck.run.forking import ForkServers
from crosscheck.run.isolation import ChildProcesses, ask, open_scratch_folder

MODULE = "campaigns.beyond.trial"
ENOUGH = 0.5  # of the faults above the bars are named, alone or in a set
# Faults that one process tries: they share the columns of all causes, which take most of the time of a march.
CHUNK = 12
PATIENCE = 900.0  # [s] that one fault may take: a beam in space with three refinements, and some hundred trial models


@dataclass(frozen=True)
class Bench:
    """A mechanism with one of its cases, the engines in which faults are planted, and how often it is drawn [-].

    in_package : a mechanism of this package instead of one of the project's models
    """

    mechanism: str
    case: str
    engines: tuple[str, ...]
    weight: float = 1.0
    in_package: bool = False


OWN = Path(__file__).parent / "mechanisms"
RIGID = ("pinocchio", "mujoco", "exudyn")
LOOPS = ("pinocchio", "mujoco", "exudyn-dae")
BEAMS = ("exudyn-ge", "exudyn-ancf")


@dataclass(frozen=True)
class Campaign:
    """Benches, the number of faults, and the seed they are drawn from."""

    name: str
    benches: tuple[Bench, ...]
    count: int
    seed: int


FIRST = Campaign(
    "first",
    (
        Bench("double_pendulum", "swing", RIGID),
        Bench("rigid_3r", "quintic", RIGID),
        Bench("ur5", "reach", RIGID, 1.5),
        Bench("elastic_drives", "swing", RIGID, 1.5),
        Bench("four_bar", "turn", LOOPS),
        Bench("slider_crank", "turns", LOOPS),
        Bench("andrews_squeezer", "turn", LOOPS),
        Bench("five_bar_redundant", "reach", LOOPS, 0.5),
        Bench("flex_one_link", "cycloid", (*BEAMS, "mujoco-flex"), 2.0),
        Bench("flex_two_link", "cycloid", BEAMS, 2.0),
        Bench("flex_one_link_damped", "cycloid", BEAMS),
        Bench("four_bar_flexible", "turn", BEAMS, 2.0),
        Bench("spatial_arm", "reach", ("exudyn-ge",), 0.8),
        Bench("service_arm", "reach", ("pinocchio", "mujoco"), 2.0, in_package=True),
        Bench("boom", "slew", ("exudyn-ge",), 0.5, in_package=True),
    ),
    180,
    20260729,
)
SECOND = Campaign(
    "second",
    (
        Bench("talos_arm", "wave", RIGID, 1.5),
        Bench("panda", "pick", RIGID),
        Bench("rigid_one_link", "cycloid", RIGID),
        Bench("quanser_2dsfl_rigid", "moves", RIGID),
        Bench("five_bar", "reach", LOOPS),
        Bench("geared_four_bar", "turn", ("pinocchio", "mujoco")),
        Bench("stewart_platform", "swoop", ("pinocchio", "mujoco"), 0.5),
        Bench("bricard", "fold", ("pinocchio", "mujoco")),
        Bench("slider_crank_flexible", "turn", BEAMS, 2.0),
        Bench("flex_one_link", "bang_bang", ("exudyn-ge",), 1.0),
        Bench("four_bar_flexible", "fast", BEAMS, 1.5),
        Bench("ur5_flexible_forearm", "reach", ("exudyn-ge",), 0.8),
        Bench("rocker_press", "stroke", LOOPS, 2.0, in_package=True),
    ),
    180,
    7041776,
)
CAMPAIGNS = {one.name: one for one in (FIRST, SECOND)}
Notify = Callable[[int, int, Mapping[str, Any]], None]


@dataclass(frozen=True)
class CampaignRequest:
    """Request to run a campaign or a part of it: folders of models and results, and the number of processes.

    mechanisms, only : names and numbers of faults to be left with; none: all
    """

    campaign: Campaign
    models: Path
    out: Path
    jobs: int = 1
    mechanisms: tuple[str, ...] = ()
    only: tuple[int, ...] = ()

    def make_place(self, bench: Bench, engine: str, folder: Path) -> TrialLocation:
        """Return the Place at which faults of an engine are tried; folder : of all files that nobody needs afterwards."""
        models = OWN if bench.in_package else self.models
        return TrialLocation(str(models.resolve()), bench.mechanism, bench.case, engine, str(folder / "unharmed"))


@dataclass
class _CampaignProgress:
    """Work in progress of a campaign: processes, rows that came in, and the callback for them; threads share it.

    pool : of as many threads as wanted; they live as long as the work, for what they have started dies with them
    """

    wanted: CampaignRequest
    notify: Notify
    pool: ThreadPoolExecutor
    children: ChildProcesses
    total: int = 0
    rows: list[dict[str, Any]] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, rows: Iterable[dict[str, Any]]) -> None:
        """Take rows and tell about them."""
        with self.lock:
            for row in rows:
                self.rows.append(row)
                self.notify(len(self.rows), self.total, row)


def run(request: CampaignRequest, notify: Notify = lambda done, total, row: None) -> dict[str, Any]:
    """Run a campaign; return and write its results: every fault with its outcome, and the sums.

    One that is interrupted writes what it has.  Raises RuntimeError where an unharmed engine cannot be run.
    """
    start = clock.monotonic()
    servers = ForkServers()
    request.out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(request.jobs) as pool:
        work = _CampaignProgress(request, notify, pool, ChildProcesses(servers=servers))
        try:
            with open_scratch_folder() as folder:
                _run_campaign_steps(work, folder)
        except KeyboardInterrupt:
            work.children.end_processes()
            _write(
                request,
                {**make_results(request, work.rows, clock.monotonic() - start), "met": False, "finished": False},
            )
            raise
        finally:
            servers.close()
    results = {**make_results(request, work.rows, clock.monotonic() - start), "finished": True}
    _write(request, results)
    return results


def _write(request: CampaignRequest, results: Mapping[str, Any]) -> None:
    (request.out / "beyond.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def _run_campaign_steps(work: _CampaignProgress, folder: Path) -> None:
    """Run unharmed engines, draw faults, and try them; records stand in a folder that is thrown away."""
    wanted = work.wanted
    chosen = work.wanted.campaign
    scenes = [(bench, engine) for bench in chosen.benches for engine in bench.engines]
    places = [wanted.make_place(*one, folder) for one in scenes]
    _run_unharmed_engines(work, [wanted.make_place(bench, REFERENCE, folder) for bench in chosen.benches])
    weights = [bench.weight / len(bench.engines) for bench, _ in scenes]
    drawn = draw([place.read_setup() for place in places], weights, chosen.count, chosen.seed)
    tried = [d for d in drawn if _is_wanted(wanted, places[d.scene], d)]
    used = sorted({d.scene for d in tried})
    _run_unharmed_engines(work, [places[k] for k in used])
    controls = [] if wanted.only else [DrawnFault(0, k, (), (), chosen.seed) for k in used]
    work.total = len(tried) + len(controls)
    _run_faults(work, places, [*controls, *tried], folder)


def _is_wanted(request: CampaignRequest, place: TrialLocation, drawn_fault: DrawnFault) -> bool:
    here = not request.mechanisms or place.mechanism in request.mechanisms
    there = describe_missing_package(ENGINES[place.engine]) is None
    return here and there and (not request.only or drawn_fault.number in request.only)


def _run_unharmed_engines(work: _CampaignProgress, places: Sequence[TrialLocation]) -> None:
    """Run engines unharmed, in processes; those of one mechanism in one."""
    groups: dict[str, list[dict[str, str]]] = {}
    for place in places:
        groups.setdefault(place.mechanism, []).append(asdict(place))
    if places and places[0].engine == REFERENCE:  # kernels compile once, whichever mechanism comes first
        groups = {"": [words for group in groups.values() for words in group]}

    def run_group(group: list[dict[str, str]]) -> None:
        job = {
            "kind": "study",
            "path": str(ROOT),
            "module": MODULE,
            "function": "prepare",
            "options": {"places": group},
        }
        answer, ending = ask(job, PATIENCE * len(group), work.children)
        bad = [row for row in answer or () if row["status"] != "ok"]
        if answer is None or bad:
            words = ending.message or ending.printed if answer is None else str(bad[0])
            raise RuntimeError(f"unharmed engines of {group[0]['mechanism']} cannot be run: {words}")

    _run_side_by_side(work, [functools.partial(run_group, group) for group in groups.values()])


def _run_side_by_side(work: _CampaignProgress, things: Sequence[Callable[[], None]]) -> None:
    """Do things side by side, as many at a time as wanted; Ctrl-C ends what is under way and begins nothing more."""
    futures = [work.pool.submit(thing) for thing in things]
    try:
        wait(futures)
    except KeyboardInterrupt:
        for future in futures:
            future.cancel()
        work.children.end_processes()
        raise
    for future in futures:
        future.result()


def _run_faults(
    work: _CampaignProgress, places: Sequence[TrialLocation], drawn: Sequence[DrawnFault], folder: Path
) -> None:
    """Try faults, in processes of some faults each; the slow ones begin first."""
    chunks: list[tuple[TrialLocation, list[DrawnFault]]] = []
    for k, place in enumerate(places):
        mine = [d for d in drawn if d.scene == k]
        chunks += [(place, mine[i : i + CHUNK]) for i in range(0, len(mine), CHUNK)]
    chunks.sort(key=lambda chunk: chunk[0].read_setup().rigid)
    _run_side_by_side(
        work,
        [functools.partial(_run_fault_group, work, *chunk, folder / f"chunk{n}") for n, chunk in enumerate(chunks)],
    )


def _run_fault_group(work: _CampaignProgress, place: TrialLocation, drawn: list[DrawnFault], folder: Path) -> None:
    """Try some faults in one process, and the rest in another where it dies; tell of each when it is done."""
    left = list(drawn)
    attempt = 0
    while left:
        here = folder / str(attempt)
        here.mkdir(parents=True, exist_ok=True)
        lines = (here / "rows.jsonl").resolve()
        options: dict[str, Any] = {"place": asdict(place), "drawn": [asdict(d) for d in left]}
        options |= {"lines": str(lines), "scratch": str(here.resolve())}
        job = {"kind": "study", "path": str(ROOT), "module": MODULE, "function": "run_trials", "options": options}
        with RowFollower(lines, work):
            _, ending = ask(job, PATIENCE * len(left), work.children)
        done = {row["number"] for row in _read_rows(lines)}
        left = [d for d in left if d.number not in done]
        if left and work.children.stopped:
            return
        if left:  # the process ended in the first of them
            lost = left.pop(0)
            words = f"{ending.status}: {ending.message} {ending.printed[-400:]}"
            where = {"mechanism": place.mechanism, "case": place.case, "engine": place.engine}
            row = {"number": lost.number, **where, "recipe": lost.name, "topic": lost.topic, "seed": lost.seed}
            work.add([{**row, "fault": lost.name, "outcome": "failed", "words": words, "seconds": ending.elapsed}])
        attempt += 1


class RowFollower:
    """Takes rows from a file while another process writes them."""

    def __init__(self, lines: Path, work: _CampaignProgress) -> None:
        """Follow a file."""
        self.lines = lines
        self.work = work
        self.taken = 0
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._take_until_end, daemon=True)

    def __enter__(self) -> RowFollower:
        self.thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.over.set()
        self.thread.join()
        self._take()

    def _take_until_end(self) -> None:
        while not self.over.wait(1.0):
            self._take()

    def _take(self) -> None:
        rows = _read_rows(self.lines)
        new = rows[self.taken :]
        self.taken = len(rows)
        self.work.add(new)


def _read_rows(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a file of which the last may be unfinished."""
    if not file.is_file():
        return []
    text = file.read_text(encoding="utf-8")
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


def make_results(request: CampaignRequest, rows: Sequence[dict[str, Any]], elapsed: float) -> dict[str, Any]:
    """Return the results: campaign, seed, sums over all and by topic and by engine, and every row in order."""
    ordered = sorted(rows, key=lambda row: (row["number"], row["mechanism"], row["engine"]))
    faults = [row for row in ordered if row["number"]]

    def compute_group_shares(of: Iterable[dict[str, Any]]) -> dict[str, Any]:
        return compute_shares((row["outcome"], row.get("effect", "")) for row in of)

    def split_by(key: str) -> dict[str, Any]:
        return {
            v: compute_group_shares(r for r in faults if r[key] == v) for v in sorted({str(r[key]) for r in faults})
        }

    whole = compute_group_shares(faults)
    spoilt = [row for row in ordered if not row["number"] and row["outcome"] != "silent"]
    return {
        "campaign": request.campaign.name,
        "seed": request.campaign.seed,
        "count": request.campaign.count,
        "elapsed": elapsed,
        "met": whole["bad"] == 0 and not spoilt and whole["share"] >= ENOUGH,
        "sums": whole,
        "unharmed": {"tried": len(ordered) - len(faults), "spoilt": len(spoilt)},
        "by newness": {
            "sayable by the old dictionary": compute_group_shares(row for row in faults if not is_new(row)),
            "new to it": compute_group_shares(row for row in faults if is_new(row)),
        },
        "by topic": split_by("topic"),
        "by engine": split_by("engine"),
        "by mechanism": split_by("mechanism"),
        "rows": ordered,
    }
