"""Trials: what every release gave so far, in a file that a second run goes on from."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from crosscheck import output_folder as owned
from crosscheck.bisect.environments import Environment, EnvironmentStore, EnvironmentWish
from crosscheck.bisect.installers import CannotInstall
from crosscheck.bisect.observations import (
    Observation,
    ObservationEntry,
    Reading,
    make_failed_observation,
    read_entry,
    read_observation,
)
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import Script, run_script

STATE = "trials.json"
NO_WHEEL_HERE = "no wheel for a Python that is installed here"


class TrialEntry(TypedDict):
    """Trials of one release as JSON values; pins : of its environment, "" where there was none."""

    pins: str
    observations: list[ObservationEntry]


@dataclass(frozen=True)
class Question:
    """Question to every release: package, what is installed beside it, the script, and what of it is read."""

    package: str
    beside: tuple[str, ...]
    script: Script
    reading: Reading

    def compute_digest(self) -> str:
        """Return a digest of the question; its range is no part of it: another range takes what was found."""
        said = (self.package, self.beside, self.script.compute_digest(), self.reading)
        return hashlib.sha256(repr(said).encode()).hexdigest()


@dataclass
class Trial:
    """Trials of a release: the pins of its environment, and every run."""

    pins: str = ""
    observations: list[Observation] = field(default_factory=list)


@dataclass
class Trials:
    """The trials of a question; folder : where they are kept; notify : is told of what is begun, release and words.

    taken : releases of which an earlier run had tried some; spent : processor time of earlier runs of the question [s]
    """

    question: Question
    store: EnvironmentStore
    folder: Path
    notify: Callable[[str, str], None] = lambda release, words: None
    trials: dict[str, Trial] = field(default_factory=dict)
    taken: int = 0
    spent: float = 0.0

    def read_kept(self) -> None:
        """Take what an earlier run of the same question has kept; what cannot be read, or answers another one, is left."""
        try:
            data = json.loads((self.folder / STATE).read_text(encoding="utf-8"))
            if data["question"] != self.question.compute_digest():
                return
            kept = {
                release: Trial(entry["pins"], [read_entry(one) for one in entry["observations"]])
                for release, entry in data["trials"].items()
            }
            spent = float(data["processor"])
        except (OSError, ValueError, LookupError, TypeError, AttributeError):
            return
        self.trials = kept
        self.spent = spent
        self.taken = len(kept)

    def run_release(self, release: Release, times: int) -> list[Observation]:
        """Return the first so many runs of a release, done where they are not kept; a release that has no environment has one."""
        trial = self.trials.setdefault(str(release), Trial())
        if release.python is None:
            trial.observations = [make_failed_observation(NO_WHEEL_HERE)]
        if len(trial.observations) < times and (trial.pins or not trial.observations):
            self._run_in_environment(release, trial, times)
        return trial.observations[:times]

    def _run_in_environment(self, release: Release, trial: Trial, times: int) -> None:
        """Run the script in the environment of a release until it has run so many times, and keep each run."""
        self.notify(str(release), "environment")
        try:
            with self.store.open_environment(self.make_wish(release)) as environment:
                trial.pins = environment.pins
                while len(trial.observations) < times:
                    self.notify(str(release), f"run {len(trial.observations) + 1}")
                    trial.observations.append(self.run_once(environment))
                    self._write_kept()
        except CannotInstall as error:
            trial.observations = [make_failed_observation(str(error))]
            self._write_kept()

    def make_wish(self, release: Release, constraints: tuple[str, ...] = ()) -> EnvironmentWish:
        """Return the contents that the environment of a release shall have."""
        assert release.python is not None
        requirements = (f"{self.question.package}=={release}", *self.question.beside)
        return EnvironmentWish(release.python, requirements, constraints)

    def run_once(self, environment: Environment) -> Observation:
        """Run the script once in an environment."""
        with run_script(self.question.script, environment.python) as (end, folder):
            return read_observation(end, folder, self.question.reading)

    @property
    def environments(self) -> int:
        """Number of releases that needed an environment, kept ones of earlier runs with them."""
        return sum(bool(trial.pins) for trial in self.trials.values())

    def compute_processor_time(self) -> float:
        """Return the processor time of this question: of earlier runs, of this process and of all that it has waited for [s]."""
        times = os.times()
        return self.spent + times.user + times.system + times.children_user + times.children_system

    def _write_kept(self) -> None:
        """Write what is known so far, and what it took."""
        trials = {
            release: {"pins": trial.pins, "observations": [one.plain for one in trial.observations]}
            for release, trial in self.trials.items()
            if trial.observations
        }
        data = {
            "question": self.question.compute_digest(),
            "processor": self.compute_processor_time(),
            "trials": trials,
        }
        owned.write(self.folder / STATE, json.dumps(data, indent=1))
