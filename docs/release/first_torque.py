"""What an installed wheel gives without a checkout: the first torque of a pendulum and of a strip that bends, and their time.

    python docs/release/first_torque.py [--shipped]

Run it outside the checkout.  With --shipped the wheel must have brought machine code for this processor, Python, Numba and
llvmlite: a kernel that is compiled, or machine code that is refused, is an error.  Without it kernels are compiled.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import click

STARTED = time.perf_counter()
import numpy as np  # noqa: E402

import flexinv  # noqa: E402
from flexinv.model.mechanism import Body, Inertia, Joint, Link, Mechanism  # noqa: E402

IMPORTED = time.perf_counter()


def pendulum() -> Mechanism:
    """Return a body of 1 kg whose centre hangs 0.5 m beside its joint, under gravity."""
    bob = Link("bob", (Body("bob", Inertia(1.0, np.array([0.5, 0.0, 0.0]), 1e-3 * np.eye(3))),))
    pin = Joint("pin", "revolute", "world", "bob", axis=np.array([0.0, -1.0, 0.0]))
    return Mechanism("pendulum", (bob,), (pin,), gravity=np.array([0.0, 0.0, -9.81]))


def strip() -> Mechanism:
    """Return the strip of `models/flex_one_link` that came with the wheel."""
    return flexinv.load_mechanism(Path(sys.prefix) / "share" / "flexinv" / "models" / "flex_one_link")


def main(shipped: bool) -> None:
    """Print the torques and the seconds that they took; raise SystemExit where machine code should have served."""
    from numba.core import event

    listener = event.RecordingListener()
    with warnings.catch_warnings(), event.install_listener("numba:compile", listener):
        warnings.simplefilter("error" if shipped else "default", RuntimeWarning)
        turn = flexinv.Motion.point_to_point([0.0], [1.0], duration=0.2, law="quintic")
        held = flexinv.solve(pendulum(), turn, step=0.01).torque[0, 0]
        bent = flexinv.solve(strip(), turn, step=1e-3).torque
    compiled = [one for _, one in listener.buffer if one.is_start]
    click.echo(
        f"import {IMPORTED - STARTED:.2f} s, torques {time.perf_counter() - IMPORTED:.2f} s, compiled {len(compiled)}"
    )
    if abs(abs(held) - 0.5 * 9.81) > 1e-9 or not 0.0 < abs(bent).max() < 1.0:
        raise SystemExit(f"wrong torques: {held} N m, {abs(bent).max()} N m")
    if shipped and compiled:
        raise SystemExit(f"{len(compiled)} kernels were compiled although machine code came along")


if __name__ == "__main__":
    main("--shipped" in sys.argv[1:])
