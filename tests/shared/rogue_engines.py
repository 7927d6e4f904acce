"""Engines that misbehave, each in one way: run in real child processes by the tests of crosscheck.

They have the functions of an adapter and are registered by the module path in ``crosscheck.engines.Engine``.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.engines import Engine
from crosscheck.engines.base import sample_times
from crosscheck.measures.budget import Family, add_error_bars
from crosscheck.measures.certificate import Certificate
from crosscheck.measures.record import Record, Series, torque_series
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


def engine(kind: str) -> Engine:
    """Return the registry entry of a rogue."""
    return Engine(kind, "rogue_engines", "numpy", "never")


def version() -> str:
    return "0.rogue"


def abilities() -> str:
    return "Does one thing wrong."


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    return "has no legs" if engine == "refusing" else None


def run(mechanism: Mechanism, case: Case, engine: str, options: Mapping[str, Any]) -> Record:
    return {
        "fine": fine,
        "hanging": hang,
        "stubborn": stubborn,
        "killed": kill,
        "crashing": crash,
        "leaving": leave,
        "raising": fail,
        "nan": not_a_number,
        "runaway": run_away,
        "wide": widen,
        "massive": lambda m, c, o: pinocchio(m, c, "massive", o),
        "truncated": truncated,
        "garbage": garbage,
        "breeding": breed,
        "fleeing": flee,
        "leaving-behind": leave_behind,
        "empty": lambda m, c, o: Record("empty"),
        "drifting": drift,
        "drawing": draw,
        "damped": damped,
        "heavy": lambda m, c, o: pinocchio(m, c, "heavy", o),
        "noisy": lambda m, c, o: scattered(m, c, "noisy", o, None),
        "steady": lambda m, c, o: scattered(m, c, "steady", o, 1),
        "trembling": lambda m, c, o: off(m, c, "trembling", o),
        "worsened": lambda m, c, o: off(m, c, "worsened", o),
        "odd-settings": lambda m, c, o: replace(fine(m, c, o), settings={"step": float("nan")}),
    }[engine](mechanism, case, options)


def fine(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    time = sample_times(case)
    torque = np.sin(10.0 * time)[:, None] * np.arange(1.0, mechanism.nv + 1.0)
    return Record("fine", time=time, series=torque_series(mechanism, torque))


def draw(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """Torques from the generator that all of a process share."""
    good = fine(mechanism, case, options)
    noise = np.random.standard_normal(good.time.size)  # noqa: NPY002 - this generator is what is tested
    return replace(good, series={n: replace(s, values=noise) for n, s in good.series.items()})


def drift(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    good = fine(mechanism, case, options)
    return replace(good, time=good.time * 1.001)


def damped(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """Pinocchio, with 0.05 N m s/rad more in the last joint: a cause that has a name."""
    from crosscheck.engines.pinocchio import adapter as pinocchio

    last = replace(mechanism.joints[-1], damping=mechanism.joints[-1].damping + 0.05)
    return pinocchio.run(replace(mechanism, joints=(*mechanism.joints[:-1], last)), case, "damped", options)


def pinocchio(mechanism: Mechanism, case: Case, name: str, options: Mapping[str, Any]) -> Record:
    from crosscheck.engines.pinocchio import adapter as pinocchio

    return pinocchio.run(mechanism, case, name, options)


def off(mechanism: Mechanism, case: Case, name: str, options: Mapping[str, Any]) -> Record:
    """Pinocchio, 4e-13 of the range off in its torques; "trembling" by as much less as the last digits of its input say."""
    good = pinocchio(mechanism, case, name, options)
    place = case.motion.evaluate(mechanism, np.array([case.end / 3]))[0][0]
    digits = int(place[np.abs(place) > 0][:1].view(np.int64)[0]) % 16 if name == "trembling" else 0

    def moved(one: Series) -> Series:
        size = 4e-13 * (1 - digits / 32) * float(np.ptp(one.values)) if one.quantity == "torque" else 0.0
        return replace(one, values=one.values + size)

    return replace(good, series={n: moved(one) for n, one in good.series.items()})


def scattered(mechanism: Mechanism, case: Case, name: str, options: Mapping[str, Any], seed: int | None) -> Record:
    """Pinocchio with white noise of +-1.6 % of the range in its torques; with a seed it is the same in every process.

    Noise that is never larger is covered by what it does to refinement, whatever is drawn; a normal one sometimes is not.

    The noise of "steady" differs between its three refinements only, as that of an engine that depends on its step.
    """
    random = np.random.default_rng(seed)
    good = pinocchio(mechanism, case, name, options)

    def noise(one: Series) -> Series:
        size = 0.016 * float(np.ptp(one.values)) if one.quantity == "torque" else 0.0
        return replace(one, values=one.values + size * random.choice([-1.0, 1.0], one.values.size))

    levels = [{n: noise(s) for n, s in good.series.items()} for _ in range(3)]
    if seed is None:
        return replace(good, series=levels[-1])
    made, budget = add_error_bars(levels[-1], [Family("step", levels)])
    return replace(good, series=made, budget=budget)


def not_a_number(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    good = fine(mechanism, case, options)
    next(iter(good.series.values())).values[3] = np.nan
    return good


def run_away(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """One finite number whose square is none."""
    good = fine(mechanism, case, options)
    next(iter(good.series.values())).values[3] = 1e308
    return good


def widen(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """One finite error bar whose square is none."""
    good = fine(mechanism, case, options)
    series = {n: replace(s, error=np.full(s.values.shape, 1e308)) for n, s in good.series.items()}
    return replace(good, series=series)


def truncated(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    good = fine(mechanism, case, options)
    series = {n: replace(s, values=s.values[:5]) for n, s in good.series.items()}
    return replace(good, time=good.time[:5], series=series)


def hang(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    Path(options["pids"], str(os.getpid())).touch()
    clock.sleep(600.0)
    return Record("hanging")


def stubborn(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    return hang(mechanism, case, options)


def escape(pids: str) -> None:
    """Start a process in a session of its own, which no signal to the group of this one reaches."""
    code = f"import os, pathlib, time; pathlib.Path({pids!r}, str(os.getpid())).touch(); time.sleep(600)"
    subprocess.Popen([sys.executable, "-c", code], start_new_session=True, stdin=subprocess.DEVNULL)
    while len(list(Path(pids).iterdir())) < 1:
        clock.sleep(0.01)


def flee(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """Hang, and have a child that has left the group."""
    escape(options["pids"])
    return hang(mechanism, case, options)


def leave_behind(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    """Crash, and leave a child that has left the group."""
    escape(options["pids"])
    os.abort()


def breed(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    return hang(mechanism, case, options)


def kill(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    os.kill(os.getpid(), signal.SIGKILL)
    return Record("killed")


def crash(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    os.write(2, b"the solver's last words\n")
    os.abort()


def leave(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    os.write(2, b"licence expired\n")
    os._exit(3)


def fail(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    raise ArithmeticError("singular <matrix> & worse")


def garbage(mechanism: Mechanism, case: Case, options: Mapping[str, Any]) -> Record:
    os.write(1, b"\x00\xff\xfe{]}\x1b[31m" * 10000)
    return fine(mechanism, case, options)


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """What they say of their own models: one has a tenth more mass, one as much as a number can say, others say nothing."""
    from crosscheck.engines.pinocchio import certificate as pinocchio_certificate

    if engine not in ("heavy", "massive"):
        raise InputError("this formulation has nothing to be asked for")
    good = pinocchio_certificate.certify(mechanism, case, engine)
    return replace(good, mass=1.1 * (good.mass or 0.0) if engine == "heavy" else 1e308)


def study(models: str) -> dict[str, Any]:
    rows = [
        {"what": "<b>bold</b>", "size": 1.0, "side": 10, "verdict": "within"},
        {"what": "crooked", "size": 2e-5, "side": 20, "verdict": "deviation", "message": "it is not straight"},
    ]
    columns = [("what", "what", ""), ("size", "size", "m"), ("side", "side", "m"), ("message", "words", "")]
    return {"columns": columns, "rows": rows, "plot": {"x": "side", "y": "size", "group": "what", "log": True}}


def no_study(models: str) -> dict[str, Any]:
    raise FileNotFoundError("the archive is empty")
