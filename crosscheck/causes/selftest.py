"""The checker is checked: every cause is planted in an engine's model, and has to be named.

A fault goes into the input of the *engine's adapter* (the mechanism, the motion, its options) or into the treatment of
the engine's answer; flexinv's reference stays unharmed.  The difference of the two records is all that the naming sees.
Where the mechanism is unharmed, no cause may be named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.causes.dictionary import DICTIONARY
from crosscheck.causes.evidence import Evidence
from crosscheck.causes.fault_benches import Bench
from crosscheck.causes.fit import IMPOSSIBLE, Candidate, list_candidates
from crosscheck.causes.model import Model, apply_to_record, make_model
from crosscheck.causes.naming import NamedCauses, find_causes
from crosscheck.causes.pairs import AND
from crosscheck.causes.quantities import Quantities, collect_quantities
from crosscheck.causes.single_samples import HELD, OUT, ZERO, count_few, find_sample_causes
from crosscheck.causes.single_samples import NAME as SINGLE
from crosscheck.causes.subject import Subject
from crosscheck.engines import ENGINES, adapter
from crosscheck.engines.base import offered
from crosscheck.engines.flexinv.certificate import certify
from crosscheck.engines.shared.rounding import add_rounding_bars
from crosscheck.measures.certificate import Certificate, checks
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Closure, Mechanism

SIZES = (0.001, 0.01, 0.1)  # of the size that matters
DIRECTION = np.array([0.78, -0.55, 0.31])  # of sizes with several numbers: no axis of anything
# Exact engines on the same q, qd, qdd differ by rounding, 1e-12 of the range and, in closed loops whose condition is up to
# 1e3, by 1e-9: below that nothing is a difference.
ROUNDING = 1e-9
SAMPLES = 60  # of a rigid case
CLEAN = "(nothing)"
SOFT = "soft constraint"
RANK = "closure of wrong rank"
BESIDE = "viscous damping"  # a fault beside single samples


@dataclass(frozen=True)
class PlantedFault:
    """One fault and what was made of it.

    size : [unit of the cause]; change : largest change of the engine's efforts over their range [-]
    outcome : "alone", "first", "in the set", "another", "none", "unseen"; for the clean mechanism "silent" or "another"
    """

    bench: str
    cause: str
    target: str
    size: float
    change: float
    outcome: str
    named: tuple[str, ...]
    words: str = ""


FOUND = ("alone", "first", "in the set", "silent")
MATTERS = 0.01  # of the range: faults that change the torque by as much have to be named


@dataclass(frozen=True)
class BenchSetup:
    """A bench with all that its faults share: the model of the reference, its record, its columns, the error bars.

    certificate : of the reference; noise : [-] of the range; agreed : by series [unit], how far the unharmed engines may be apart
    """

    bench: Bench
    subject: Subject
    model: Model
    reference: Record
    clean: Record
    certificate: Certificate
    known: list[Candidate]
    noise: float
    agreed: Mapping[str, float]


def prepare(bench: Bench, models: Path) -> BenchSetup:
    """Run reference and engine unharmed, and compute the columns of the dictionary."""
    folder = models / bench.mechanism
    mechanism = read_mechanism(folder)
    case = load_cases(folder, mechanism)[bench.case]
    mechanism, case = bench.make_bench_case(mechanism, case)
    if mechanism.is_rigid:  # exact at every sample: fewer of them do
        spacing = case.sample * max(1, round(case.end / case.sample / SAMPLES))
        case = replace(case, sample=spacing, step=spacing)
    options = dict(bench.options or {})
    if options:
        options["step"] = case.sample / bench.steps
    subject = Subject(mechanism, case, options)
    bars = not mechanism.is_rigid
    reference = adapter(ENGINES["flexinv"]).run(mechanism, case, "flexinv", {"error": bars})
    model = make_model(replace(subject, options={}), reference)
    clean = ask(bench, subject)
    noise = ROUNDING
    agreed = collect_quantities(model, clean, reference).agreed
    if bars:
        finer = ask(bench, subject.update_options(refinement=1))
        rounding = max(
            float(np.max(s.error)) for s in reference.series.values() if s.error is not None and s.quantity == "torque"
        )
        # Both of second order: the error of the coarse run is 4/3 of what halving does.
        noise = rounding / float(model.scale.min()) + 4 / 3 * float(np.abs(model.compute_residual(clean, finer)).max())
        agreed = compute_allowed_differences(reference, clean, finer)
    certificate = certify(mechanism, case, "flexinv")
    return BenchSetup(
        bench, subject, model, reference, clean, certificate, list_candidates(model, DICTIONARY), noise, agreed
    )


def compute_allowed_differences(reference: Record, clean: Record, finer: Record) -> dict[str, float]:
    """Return by series how far an engine and the reference may be apart [unit]: error bars, and what halving its step does."""
    allowed_differences = {}
    for key, one in clean.series.items():
        error = reference.series[key].error if key in reference.series else None
        if error is not None and key in finer.series:
            halved = float(np.abs(one.values - finer.series[key].values).max())
            # Other formulations measure a beam's end forces elsewhere: what the unharmed engines differ by is no fault.
            unharmed = float(np.abs(one.values - reference.series[key].values).max())
            allowed_differences[key] = max(float(error.max()) + 4 / 3 * halved, unharmed)
    return allowed_differences


def ask(bench: Bench, subject: Subject) -> Record:
    """Return the record of the bench's engine for a subject: the engine's own run, then the changes of its efforts."""
    engine = adapter(ENGINES[bench.engine])
    record = engine.run(subject.mechanism, subject.case, bench.engine, subject.options)
    return apply_to_record(record, subject)


def apply_soft_constraint(setting: BenchSetup, size: float) -> Record:
    """Return MuJoCo's efforts with the fraction ``size`` [-] of what its soft equality constraints give.

    Stiffness multiplies what rounding leaves open of the loops: they carry error bars of rounding, as in `crosscheck run`.
    """
    bench = replace(setting.bench, engine="mujoco-equality")
    mechanism = setting.subject.mechanism
    case = setting.subject.case
    engine = adapter(ENGINES[bench.engine])
    soft = add_rounding_bars(engine, ask(bench, setting.subject), mechanism, case, setting.subject.options)
    mixed = {}
    for key, one in setting.clean.series.items():
        if one.quantity == "torque":
            other = soft.series[key]
            bar = None if other.error is None else size * other.error
            mixed[key] = replace(one, values=(1 - size) * one.values + size * other.values, error=bar)
    return replace(setting.clean, series={**setting.clean.series, **mixed})


def add_error_bars(setting: BenchSetup, harmed: Record) -> BenchSetup:
    """Return the setting with the error bars [unit] that a harmed engine states of its torques beside those of the unharmed."""
    bars = {
        n: float(np.max(s.error)) for n, s in harmed.series.items() if s.quantity == "torque" and s.error is not None
    }
    noise = max([setting.noise, *(bar / float(setting.model.scale.min()) for bar in bars.values())])
    agreed = {name: max(known, bars.get(name, 0.0)) for name, known in setting.agreed.items()}
    return replace(setting, noise=noise, agreed=agreed)


def run_fault(setting: BenchSetup, candidate: Candidate, size: float) -> PlantedFault | None:
    """Plant one fault of a size (a fraction of the size that matters [-]); None where the engine cannot take it.

    A fault that makes a plane mechanism spatial gives Exudyn other elements with other errors: it is planted elsewhere.
    """
    for numbers in _list_fault_sizes(candidate, size):
        with suppress(*IMPOSSIBLE, RuntimeError, KeyError):
            if (result := _run_fault_of_size(setting, candidate, size, numbers)) is not None:
                return result
    return None


def _list_fault_sizes(candidate: Candidate, size: float) -> list[NDArray[np.float64]]:
    """Return the sizes to plant [unit], the first that can be: along no axis, where it shows, where it shows most, backwards.

    Out of its plane a loop does not close, and a body at the end of its beam can only go back.
    """
    cause = candidate.cause
    if not cause.sized or cause.linear:
        return [np.ones(1)]
    shows = np.abs(candidate.columns).max(axis=0)
    usual = DIRECTION[: cause.parameters]
    some = (usual, usual * (shows > 0.0), usual * (shows == shows.max()))
    units = [part / np.linalg.norm(part) for part in some if part.any()]
    return [sign * size * candidate.scale * unit for sign in (1.0, -1.0) for unit in units]


def _run_fault_of_size(
    setting: BenchSetup, candidate: Candidate, size: float, numbers: NDArray[np.float64]
) -> PlantedFault | None:
    """Plant numbers [unit] of a cause; raises like a run."""
    cause = candidate.cause
    target = candidate.target
    subject = setting.subject
    if cause.name == SOFT:
        harmed = apply_soft_constraint(setting, size)
        setting = add_error_bars(setting, harmed)
    else:
        subject = (cause.plant or cause.change)(setting.subject, target, numbers)
        engine = adapter(ENGINES[setting.bench.engine])
        if engine.unsupported(subject.mechanism, subject.case, setting.bench.engine):
            return None  # it would leave out what was planted
        if _find_element(setting, subject) != setting.clean.settings.get("element"):
            return None
        harmed = ask(setting.bench, subject)
    if harmed.status != "ok":
        return None
    naming = find_fault_causes(setting, harmed, subject)
    change = float(np.abs(setting.model.compute_residual(harmed, setting.clean)).max())
    told = tuple(f"{f.cause.name}: {f.target}" if f.target else f.cause.name for f in naming.named)
    causes = judge_causes(naming, cause.name, target)
    return PlantedFault(
        setting.bench.label, cause.name, target, float(np.linalg.norm(numbers)), change, causes, told, naming.words
    )


def _find_element(setting: BenchSetup, subject: Subject) -> object:
    """Return the element that the engine takes for a subject, by a run of two samples; None where nothing bends."""
    if subject.mechanism.is_rigid:
        return None
    short = replace(subject.case, end=2 * subject.case.sample)
    return ask(setting.bench, replace(subject, case=short, effort=())).settings.get("element")


def find_fault_causes(setting: BenchSetup, harmed: Record, subject: Subject) -> NamedCauses:
    """Return the naming of a harmed engine, from its efforts and the certificate of its model of the harmed mechanism."""
    residual = setting.model.compute_residual(harmed, setting.reference)
    if float(np.abs(residual).max()) <= setting.noise:
        return find_causes(setting.model, residual, setting.noise, setting.known)
    certificate = _compute_certificate(setting.bench.engine, subject.mechanism, setting.subject.case)
    others = Quantities(setting.model, harmed.series, setting.reference.series, setting.agreed)
    evidence = Evidence(setting.model, residual, certificate, setting.certificate, others)
    naming = find_causes(setting.model, residual, setting.noise, setting.known, evidence)
    bars = np.full(residual.shape, setting.noise)
    return find_sample_causes(naming, evidence, harmed, setting.reference, bars, known=setting.known)[1]


def _compute_certificate(engine: str, mechanism: Mechanism, case: Case) -> Certificate:
    """Return the certificate of an engine's own model; an empty one where it says nothing."""
    try:
        certificate: Certificate = find_certifier(engine)(mechanism, case, engine)
    except (*IMPOSSIBLE, RuntimeError):
        return Certificate()
    return certificate


def find_certifier(engine: str) -> Callable[..., Any]:
    """Return the member ``certify`` of an engine's adapter."""
    certify = offered(adapter(ENGINES[engine]), "certify")
    assert certify is not None
    return certify


def judge_causes(naming: NamedCauses, cause: str, target: str) -> str:
    """Return the grade of a naming when a cause was planted at a target."""
    if not naming.found:
        return "unseen"
    if not naming.named:
        return "none"
    if (cause, target) not in [f.key for f in naming.named]:
        return "another"
    if naming.names == (cause,):
        return "alone"
    return "first" if naming.named[0].key == (cause, target) else "in the set"


def make_loose_closure(closure: Closure) -> Closure:
    """Return a closure that lets a point slide across the axis about which it should only turn."""
    across = np.cross(closure.axis, np.eye(3)[int(np.argmin(np.abs(closure.axis)))])
    return replace(closure, kind="point-on-line", axis=across / np.linalg.norm(across))


def run_rank_fault(setting: BenchSetup) -> PlantedFault | None:
    """Let a closure of the engine's model tie less than it should; only the certificate can say so: there are no efforts."""
    mechanism = setting.subject.mechanism
    case = setting.subject.case
    if not mechanism.closures:
        return None
    loose = (make_loose_closure(mechanism.closures[0]), *mechanism.closures[1:])
    ask_of = {e: find_certifier(e) for e in (setting.bench.engine, "flexinv")}
    theirs = ask_of[setting.bench.engine](replace(mechanism, closures=loose), case, setting.bench.engine)
    lines = checks(
        mechanism.name, case.name, setting.bench.engine, theirs, ask_of["flexinv"](mechanism, case, "flexinv")
    )
    wrong = tuple(line.what for line in lines if not line.holds)
    rank = "rank of the closures" in wrong and set(wrong) <= {"rank of the closures", "closure axes"}  # of the line
    found = "none" if not wrong else "alone" if rank else "another"
    return PlantedFault(setting.bench.label, RANK, mechanism.closures[0].name, 1.0, 1.0, found, wrong)


def list_sample_faults(setting: BenchSetup) -> Iterator[PlantedFault]:
    """Yield the results of single samples that are off, at the first and the last drive: alone, and beside another fault."""
    beside = next((one for one in setting.known if one.cause.name == BESIDE), None)
    names = [
        n
        for n, fault in zip(
            setting.model.base.mechanism.velocity_names, setting.model.base.mechanism.actuated, strict=True
        )
        if fault
    ]
    for name in dict.fromkeys((names[0], names[-1])):
        for kind in (OUT, ZERO, HELD):
            yield _run_sample_fault(setting, setting.subject, name, kind, (SINGLE, name))
            if beside is not None:
                subject = beside.cause.change(setting.subject, beside.target, np.array([0.1 * beside.scale]))
                yield _run_sample_fault(setting, subject, name, kind, (f"{BESIDE}{AND}{SINGLE}", beside.target))


def _run_sample_fault(
    setting: BenchSetup, subject: Subject, coordinate: str, kind: str, key: tuple[str, str]
) -> PlantedFault:
    """Let single samples of a coordinate's effort be off; key : name and target of what has to be named."""
    record = ask(setting.bench, subject)
    series = f"torque/{coordinate}"
    values = replace_samples(record.series[series].values, kind)
    harmed = replace(record, series={**record.series, series: replace(record.series[series], values=values)})
    naming = find_fault_causes(setting, harmed, subject)
    change = float(np.abs(setting.model.compute_residual(harmed, record)).max())
    told = tuple(f"{f.cause.name}: {f.target}" for f in naming.named)
    outcome = judge_causes(naming, *key)
    return PlantedFault(setting.bench.label, key[0], f"{coordinate} {kind}", 1.0, change, outcome, told, naming.words)


def replace_samples(values: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Return values (samples,) [any unit] of which as many as are few are off by a tenth of their range, zero, or held.

    Held ones follow where most changes, the others are spread over all: elsewhere these faults may not show.
    """
    out = values.copy()
    few = count_few(len(values))
    if kind == HELD:
        first = 2 + int(np.abs(values[2 + few : -2] - values[2 : -2 - few]).argmax())
        out[first + 1 : first + 1 + few] = values[first]
        return out
    rows = np.linspace(0, len(values) - 1, few + 2).round().astype(int)[1:-1]
    out[rows] = 0.0 if kind == ZERO else out[rows] + 0.1 * np.ptp(values) * np.resize([1.0, -1.0], few)
    return out


def run_without_fault(setting: BenchSetup) -> PlantedFault:
    """Return the result for the engine as it is: nothing may be named."""
    naming = find_fault_causes(setting, setting.clean, setting.subject)
    found = "another" if naming.named else "silent"
    return PlantedFault(setting.bench.label, CLEAN, "", 0.0, 0.0, found, naming.names, naming.words)


def list_faults(
    setting: BenchSetup, sizes: Sequence[float], causes: Sequence[str], targets: int
) -> Iterator[tuple[Candidate, float]]:
    """Yield what to plant: every cause at its first and last targets that show, in every size [-].

    What a bench has besides (``Bench.more``) is planted once: at the first target, in the last size.
    """
    bench = setting.bench
    places = dict[str, list[Candidate]]()
    wanted = causes or bench.planted
    for one in setting.known:
        if one.cause.name in wanted:
            places.setdefault(one.cause.name, []).append(one)
    for name_of, known in places.items():
        once = not causes and name_of in bench.more
        picked = known[:1] if once else _take_first_and_last(known, targets)
        for one in picked:
            fitted = one.cause.sized and not one.cause.linear
            for size in (sizes[-1:] if once else sizes) if fitted else (1.0,):
                yield one, size


def _take_first_and_last(known: list[Candidate], count: int) -> list[Candidate]:
    """Return the first and the last of the places of a cause, count of them [-]."""
    return known if len(known) <= count else [known[0], *known[len(known) - count + 1 :]][:count]


def run_bench(
    bench: Bench, models: Path, sizes: Sequence[float] = SIZES, causes: Sequence[str] = (), targets: int = 2
) -> list[PlantedFault]:
    """Return the rows of one bench: the unharmed mechanism, then every fault; sizes [-] of the sizes that matter."""
    setting = prepare(bench, models)
    rows = [run_without_fault(setting)]
    rows += [
        row
        for one, size in list_faults(setting, sizes, causes, targets)
        if (row := run_fault(setting, one, size)) is not None
    ]
    wanted = causes or bench.causes
    ranked = run_rank_fault(setting) if not wanted or RANK in wanted else None
    spoilt = list_sample_faults(setting) if SINGLE in (causes or bench.planted) else ()
    return [*rows, *([] if ranked is None else [ranked]), *spoilt]
