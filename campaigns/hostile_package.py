"""Python objects as hostile engines of ``hostile.py``: ``hostile_package:KIND`` does one hostile thing when it is asked."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crosscheck.engines.base import sample_times
from crosscheck.measures.record import Record, Series, torque_series

HTML = "<script>alert(1)</script>"
SLEEPER = [sys.executable, "-c", "import time; time.sleep(3000)  # of hostile.py"]


def _torque(change: Callable[[Any], Any]) -> Callable[..., Any]:
    """Return a run whose torques are changed: zeros, which no machine has."""

    def run(mechanism: Any, case: Any, engine: str) -> Record:
        time_of = sample_times(case)
        made = torque_series(mechanism, np.zeros((time_of.size, mechanism.nv)))
        return Record(
            engine=engine, time=time_of, series={n: Series(n, s.unit, change(s.values)) for n, s in made.items()}
        )

    return run


def _record(**words: Any) -> Callable[..., Any]:
    def run(mechanism: Any, case: Any, engine: str) -> Record:
        made = _torque(lambda v: v)(mechanism, case, engine)
        return Record(**{"engine": engine, "time": made.time, "series": made.series, **words})

    return run


def _raise(error: BaseException) -> Callable[..., Any]:
    def run(mechanism: Any, case: Any, engine: str) -> Any:
        raise error

    return run


def _do(what: Callable[[], Any]) -> Callable[..., Any]:
    return lambda mechanism, case, engine: what()


def _recurse() -> None:
    _recurse()


def _close_all() -> None:
    os.closerange(0, 64)


def _leave() -> None:
    subprocess.Popen(SLEEPER, start_new_session=True)
    raise ValueError("left one")


def _fork() -> None:
    if os.fork() == 0:
        os.setsid()
        time.sleep(3000)
    raise ValueError("forked one")


def _thread() -> None:
    threading.Thread(target=time.sleep, args=(3000,)).start()
    raise ValueError("left a thread")


def _replace_streams() -> None:
    sys.stdout = sys.stderr = None  # type: ignore[assignment]


RUNS: dict[str, Callable[..., Any]] = {
    "complex": _torque(lambda v: v + 1j),
    "text": _torque(lambda v: v.astype(str)),
    "objects": _torque(lambda v: np.array([object()] * v.size)),
    "masked": _torque(lambda v: np.ma.masked_array(v, v == 0.0)),
    "whole_numbers": _torque(lambda v: v.astype(int)),
    "matrix": _torque(lambda v: np.zeros((v.size, 2))),
    "short": _torque(lambda v: v[:-1]),
    "scalar": _torque(lambda v: 0.0),
    "lists": _torque(lambda v: v.tolist()),
    "nothing_in_it": _torque(lambda v: None),
    "half_numbers": _torque(lambda v: v.astype(np.float16)),
    "huge_numbers": _torque(lambda v: v + 1e308),
    "nan_numbers": _torque(lambda v: v + np.nan),
    "none": _do(lambda: None),
    "table": _do(lambda: {"torque": [1.0]}),
    "odd_status": _record(status="great"),
    "odd_message": _record(status="error", message=HTML + "\x1b[31m"),
    "message_of_bytes": _record(status="error", message=b"bytes"),
    "long_message": _record(status="error", message="x" * 5_000_000),
    "object_settings": _record(settings={"a": object()}),
    "nan_settings": _record(settings={"a": float("nan")}),
    "nan_wall_time": _record(wall_time=float("nan")),
    "certificate_of_text": _record(certificate="none"),
    "leaves_by_exit": _raise(SystemExit(0)),
    "interrupts": _raise(KeyboardInterrupt()),
    "generator_exit": _raise(GeneratorExit()),
    "memory": _do(lambda: bytearray(1 << 50)),
    "recursion": _do(_recurse),
    "leaves_at_once": _do(lambda: os._exit(0)),
    "leaves_with_code": _do(lambda: os._exit(9)),
    "crashes": _do(lambda: ctypes.string_at(0)),
    "kills_itself": _do(lambda: os.kill(os.getpid(), signal.SIGKILL)),
    "sleeps": _do(lambda: time.sleep(3000)),
    "closes_all": _do(_close_all),
    "replaces_streams": _do(_replace_streams),
    "leaves_process": _do(_leave),
    "leaves_copy": _do(_fork),
    "leaves_thread": _do(_thread),
}


class Package:
    """An adapter that does one hostile thing."""

    def __init__(self, kind: str) -> None:
        self.kind = kind

    def version(self) -> Any:
        return {"version_of_none": None, "version_of_html": HTML, "version_of_bytes": b"1"}.get(self.kind, "1")

    def abilities(self) -> Any:
        return 7 if self.kind == "abilities_of_numbers" else "One machine, and one hostile thing."

    def unsupported(self, mechanism: Any, case: Any, engine: str) -> Any:
        if self.kind == "unsupported_raises":
            raise ValueError("asked too much")
        return {"unsupported_of_numbers": 3, "unsupported_of_html": HTML + "\x1b[31m"}.get(self.kind)

    def run(self, mechanism: Any, case: Any, engine: str, options: Any) -> Any:
        return RUNS.get(self.kind, _torque(lambda v: v))(mechanism, case, engine)

    def certify(self, mechanism: Any, case: Any, engine: str) -> Any:
        if self.kind == "certify_raises":
            raise SystemExit(5)
        if self.kind == "certify_of_text":
            return "sound"
        return None


def __getattr__(name: str) -> Package:
    if name.startswith("_"):
        raise AttributeError(name)
    return Package(name)
