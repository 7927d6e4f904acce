"""FMUs against Python: every mechanism of the gallery, and random ones, at their motions, by FMPy.

    python campaigns/exported_fmus.py                        # all of them; some minutes
    python campaigns/exported_fmus.py --only ur5 --random 0

An inverse FMU is held against `TorqueFunction.sample` of rigid mechanisms and the steps of `Controller`, of which not one bit may
differ.  A forward FMU gets those torques, and its motion is held against `flexinv.simulate`.  FMPy finds nothing wrong.
Mechanisms that are not exported are listed with the words of their refusal; the command ends with 1 where anything differs.
"""

from __future__ import annotations

import importlib
import itertools
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

if __name__ == "__main__":
    ROOT = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "shared")]

import flexinv
from campaigns.exported import Outcome, add_source_options, compare_random, compute_rigid, list_gallery, march
from crosscheck.engines.flexinv_c.adapter import CasePlan, plan_case, unsupported
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MOST_STEPS = 300  # of one case
# Of the largest coordinate's way, or a radian: the same steps by the same kernel; Python reads angles off rotations, and what a
# step's Newton leaves below its tolerance is marched on.
MOVED = 1e-10


def compare_inverse(mechanism: Mechanism, case: Case, plan: CasePlan, folder: Path) -> tuple[Outcome, Array]:
    """Return what an inverse FMU answers [N m], [N] held against Python, and the efforts of Python (steps, nv)."""
    from fmu_driver import driven

    settings = plan.settings
    rigid = mechanism.is_rigid
    words = (
        {} if rigid else {"initial": settings.initial, "spectral_radius": settings.spectral_radius, "step": case.step}
    )
    start = None if rigid and not mechanism.closures else settings.start
    file = flexinv.export_fmu(mechanism, folder / "inverse.fmu", start=start, **words)
    questions = plan.questions[:MOST_STEPS]
    expected = compute_rigid(mechanism, questions) if rigid else march(mechanism, case, questions, settings)
    m = mechanism
    names = [f"{n}.q" for n in m.coordinate_names] + [f"{n}.{p}" for p in ("qd", "qdd") for n in m.velocity_names]
    names.append("phase")
    rows = np.array([np.concatenate([one.q, one.qd, one.qdd, [one.phase]]) for one in questions])
    with driven(file) as fmu:
        inputs = [k for k, name in enumerate(names) if name in fmu.places]
        given = [names[k] for k in inputs]
        efforts = [i for i, n in enumerate(m.velocity_names) if f"{n}.tau" in fmu.places]
        asked = [f"{m.velocity_names[i]}.tau" for i in efforts]
        fmu.begin(dict(zip(given, rows[0, inputs], strict=True)))
        answers = np.array([fmu.get(*asked), *fmu.replay(given, rows[1:, inputs], asked, case.step)])
    problems = importlib.import_module("fmpy.validation").validate_fmu(str(file))
    apart = float(np.abs(answers - expected[:, efforts]).max()) / (float(np.abs(expected).max()) or 1.0)
    wrong = "; ".join([*problems, *(["not the same bits"] if apart else [])])
    return Outcome(f"{m.name}/{case.name} inverse", len(rows), apart, wrong), expected


def compare_forward(mechanism: Mechanism, case: Case, plan: CasePlan, efforts: Array, folder: Path) -> Outcome:
    """Return where a forward FMU goes [rad], [m] under efforts (steps, nv) [N m], [N], held against `flexinv.simulate`."""
    from fmu_driver import driven

    m = mechanism
    start = plan.questions[0].q
    step = case.sample if m.is_rigid else case.step  # between two questions
    words = {"kind": "forward", "step": step, "start": start, "initial": case.initial}
    file = flexinv.export_fmu(m, folder / "forward.fmu", **words)
    torque = efforts[:, m.actuated]
    inputs = [f"{n}.tau" for n, is_driven in zip(m.velocity_names, m.actuated, strict=True) if is_driven]
    outputs = [f"{n}.q" for n in m.coordinate_names]
    with driven(file) as fmu:
        fmu.begin(dict(zip(inputs, torque[0], strict=True)))
        begins = np.array(fmu.get(*outputs))
        starts = {j.name: begins[m.q_slices[j.name]] for j in m.joints if j.nv}
        time = step * np.arange(len(torque))
        expected = flexinv.simulate(m, time, torque, step=step, initial=case.initial, start=starts).q
        result = np.array([begins, *fmu.replay(inputs, torque[1:], outputs, step)])
    apart = float(np.abs(result - expected).max()) / max(float(np.ptp(expected, axis=0).max()), 1.0)
    return Outcome(
        f"{m.name}/{case.name} forward", len(result), apart, "" if apart <= MOVED else f"more than {MOVED:g}"
    )


def compare_all(name: str, mechanism: Mechanism, cases: dict[str, Case]) -> Iterator[Outcome]:
    """Yield what became of the FMUs of a mechanism's cases; refusals are shown."""
    for case in cases.values():
        meshed = case.meshed(mechanism)
        reason = unsupported(meshed, case, "flexinv-c")
        if reason is not None or any(len(force.time) > 1 for force in mechanism.forces):
            click.echo(f"    {name}/{case.name}: {reason or 'forces that depend on time, which an FMU holds'}")
            continue
        with tempfile.TemporaryDirectory() as place:
            try:
                plan = plan_case(meshed, case)
                inverse, efforts = compare_inverse(meshed, case, plan, Path(place))
                yield inverse
                yield compare_forward(meshed, case, plan, efforts, Path(place))
            except (InputError, flexinv.ConvergenceError) as refusal:
                click.echo(f"    {name}/{case.name}: {refusal}")
            except Exception as error:
                yield Outcome(f"{name}/{case.name}", 0, np.inf, f"{type(error).__name__}: {error}")


@click.command()
@add_source_options
def main(only: str, count: int, seed: int) -> None:
    """Compare all FMUs with Python; end with 1 where one differs."""
    warnings.simplefilter("ignore")
    wrong = 0
    of_gallery = (one for source in list_gallery(only) for one in compare_all(*source))
    for one in itertools.chain(of_gallery, compare_random(count, seed, compare_all)):
        wrong += bool(one.wrong)
        click.echo(f"{one.name:52} {one.calls:5} steps  {one.difference:9.2e}  {one.wrong}")
    click.echo(f"{wrong} wrong")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
