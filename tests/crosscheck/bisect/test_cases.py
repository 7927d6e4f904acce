"""Cases of ours are judged by the efforts that their exported scripts compute; a wrong effort is seen, and its cause named."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from local_index import UnzippingInstaller
from packaging.version import Version

from crosscheck.bisect.answer import ChangeReport
from crosscheck.bisect.bisection import Bisection, Plan
from crosscheck.bisect.cases import (
    CaseScript,
    find_package,
    make_case_criterion,
    make_case_reading,
    resolve_engine,
    write_case_script,
)
from crosscheck.bisect.causes import OWN_COORDINATES, ask_cause, describe_case_change, run_reference
from crosscheck.bisect.defaults import list_differences, read_defaults
from crosscheck.bisect.environments import Environment, EnvironmentStore
from crosscheck.bisect.observations import Observation, read_observation
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import run_script
from crosscheck.bisect.trials import Question, Trial, Trials
from crosscheck.engines import ENGINES
from crosscheck.verdicts.plan import Task, discover
from flexinv.errors import InputError

pytestmark = pytest.mark.slow  # an engine and flexinv compute a case


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    return discover(root / "models", ["rigid_one_link/cycloid"]).tasks[0]


@pytest.fixture(scope="module")
def made(task: Task, tmp_path_factory: pytest.TempPathFactory) -> CaseScript:
    return write_case_script(task, ENGINES["mujoco"], tmp_path_factory.mktemp("case") / "files", 60.0)


@pytest.fixture(scope="module")
def observation(made: CaseScript) -> Observation:
    with run_script(made.script, sys.executable) as (end, folder):
        return read_observation(end, folder, make_case_reading())


def test_the_script_of_a_case_gives_its_efforts(task: Task, made: CaseScript, observation: Observation) -> None:
    criterion = make_case_criterion(made, task, "mujoco", by_verdict=True, tolerance=0.0)
    assert criterion.find_label("1.0", observation) == "good"
    # The limit is a millionth of the range or less: a thousandth is outside.
    wrong = replace(observation, table=observation.table * [1.0, *[1.001] * (len(observation.names) - 1)])
    assert criterion.find_label("1.1", wrong) == "bad"
    same = make_case_criterion(made, task, "mujoco", by_verdict=False, tolerance=1e-6)
    assert [same.find_label(release, one) for release, one in (("1.0", observation), ("1.1", wrong))] == ["1.0", "1.1"]
    later = observation.table.copy()
    later[:, 0] += 1.0
    shifted = replace(observation, table=later)
    assert same.find_label("1.2", shifted) == "1.0"  # the time is no effort


def test_the_cause_of_a_change_is_named(task: Task, made: CaseScript, observation: Observation, tmp_path: Path) -> None:
    """A release that gives 1.02 of every effort: a scale, or what this motion cannot tell from it."""
    wrong = replace(observation, table=observation.table * [1.0, *[1.02] * (len(observation.names) - 1)])
    releases = [Release(Version(version), find_pythons([])[0]) for version in ("1.0", "1.1")]
    store = EnvironmentStore(tmp_path, UnzippingInstaller(tmp_path))  # type: ignore[arg-type]
    trials = Trials(Question("mujoco", (), made.script, make_case_reading()), store, tmp_path)
    trials.trials = {"1.0": Trial("", [observation]), "1.1": Trial("", [wrong])}
    criterion = make_case_criterion(made, task, "mujoco", by_verdict=False, tolerance=1e-6)
    bisection = Bisection(releases, trials, criterion, Plan())
    change = ChangeReport("1.0", "1.1", "1.0", "1.1", "", "", (), [], "", None)
    old, new = describe_case_change(task, "mujoco", bisection, change).splitlines()
    assert old == "mujoco 1.0 beside flexinv: the difference is inside the error bars."
    assert "explain it" in new  # one motion of one joint cannot tell a scale from a wrong inertia
    turned = replace(made.expected, table=made.expected.table * [1.0, *[-1.0] * (len(made.expected.names) - 1)])
    reference = run_reference(task, tmp_path)
    assert ask_cause(task, ("mujoco", "1.1"), wrong, turned, reference, tmp_path) == OWN_COORDINATES


def test_defaults_of_an_engine_are_asked_for(tmp_path: Path) -> None:
    here = Environment(tmp_path, sys.executable, "", False)
    defaults = read_defaults("MuJoCo", here)
    assert defaults is not None
    assert float(defaults["option.timestep"]) == 0.002
    assert read_defaults("ball", here) is None


def test_differences_name_what_is_only_on_one_side() -> None:
    assert list_differences({"a": "1", "b": "2"}, {"b": "3", "c": "4"}) == [
        ("a", "1", ""),
        ("b", "2", "3"),
        ("c", "", "4"),
    ]


def test_an_engine_that_is_no_package_and_a_case_without_a_limit_are_named(task: Task, made: CaseScript) -> None:
    assert find_package("pinocchio") == "pin"
    assert [resolve_engine(name) for name in ("pin", "exudyn", "exudyn-ge")] == ["pinocchio", "exudyn", "exudyn-ge"]
    with pytest.raises(InputError, match="no package of the index brings 'flexinv'; expected one of mujoco, "):
        find_package("flexinv")
    bare = replace(task, case=replace(task.case, limits=()))
    with pytest.raises(InputError, match="states no limit of torque for mujoco: leave --verdict out"):
        make_case_criterion(made, bare, "mujoco", by_verdict=True, tolerance=0.0)
