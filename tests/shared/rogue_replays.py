"""Engines that replay torques and behave badly: objects for the table of feed-forwards."""

from __future__ import annotations

import os
import time as clock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.replay import DriveTorques
from flexinv.errors import InputError
from flexinv.model.mechanism import Mechanism


class ReplayAdapter:
    """An engine that is asked for replays alone."""

    def version(self) -> str:
        return "0.rogue"

    def abilities(self) -> str:
        return "it replays"

    def unsupported(self, *_: Any) -> str:
        return "replays alone"

    def run(self, *_: Any) -> Any:
        raise InputError("replays alone")

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        return {link.name: np.zeros((len(drive.torque), 3)) for link in mechanism.links}


class CrashingAdapter(ReplayAdapter):
    """It ends its process."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        os.abort()


class HangingAdapter(ReplayAdapter):
    """It comes to no end."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        clock.sleep(600.0)
        return {}


class FailingAdapter(ReplayAdapter):
    """It raises."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        raise ArithmeticError("singular")


class BlurredAdapter(ReplayAdapter):
    """One of its numbers is none."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        return {name: np.full_like(tip, np.nan) for name, tip in super().replay(mechanism, drive).items()}


class RefusingAdapter(ReplayAdapter):
    """It says why it does not."""

    def replay(self, mechanism: Mechanism, drive: DriveTorques) -> dict[str, NDArray[np.float64]]:
        raise InputError("no arms of three joints")
