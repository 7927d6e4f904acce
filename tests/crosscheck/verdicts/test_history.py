"""The history: a night is there as a whole or not at all, and two nights say what changed between them."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sql

from crosscheck.report import change_summary, html, markdown, trends
from crosscheck.verdicts import changes, history
from crosscheck.verdicts.compare import Comparison
from crosscheck.verdicts.history import HistoryError, Metric
from crosscheck.verdicts.results import CaseRow, Diagnosis, Results, RunRow
from crosscheck.verdicts.scope import Scope

ROW = Comparison("arm", "swing", "mujoco", "flexinv", "torque", "N m", "within", "", 2e-4, 1e-4, 1.0, limit=1e-3)
RUN = RunRow("arm", "swing", "mujoco", "ok", version="4.0", wall_time=2.0, elapsed=3.0, model_hash="aa")
FIRST = Results(
    "2026-03-01T01:00:00+00:00", "crosscheck nightly", 10.0, True,
    versions={"mujoco": "4.0", "numpy": "2.3"}, cases=(CaseRow("arm", "swing"),), runs=(RUN,), comparisons=(ROW,),
)  # fmt: skip


@pytest.fixture
def database(tmp_path: Path) -> sql.Engine:
    return history.open_database(f"sqlite:///{tmp_path / 'history.sqlite'}")


def later(day: int, **more: object) -> Results:
    return replace(FIRST, started=f"2026-03-{day:02}T01:00:00+00:00", **more)


def test_a_night_comes_back_and_is_added_once(database: sql.Engine) -> None:
    number = history.add_night(database, FIRST, "2026-03-01")
    assert history.add_night(database, FIRST, "2026-03-01") == number
    assert history.has_night(database, FIRST)
    assert not history.has_night(database, later(2))
    (night,) = history.list_nights(database)
    assert (night.folder, night.finished, night.exit_code, night.elapsed) == ("2026-03-01", True, 0, 10.0)
    (row,) = history.read_rows(database, history.COMPARISON, number)
    assert (row["engine"], row["fraction"], row["limit"], row["verdict"]) == ("mujoco", 2e-4, 1e-3, "within")
    (timing,) = history.read_rows(database, history.TIMING, number)
    assert (timing["wall_time"], timing["version"]) == (2.0, "4.0")
    assert history.read_rows(database, history.MODEL, number)[0]["hash"] == "aa"


def test_two_nights_of_one_second_are_two(database: sql.Engine) -> None:
    """Times are known to the second, and a night of one small mechanism takes less."""
    one = FIRST
    other = replace(one, elapsed=one.elapsed + 0.1)
    assert history.add_night(database, one) != history.add_night(database, other)
    assert len(history.list_nights(database)) == 2
    assert history.has_night(database, one)
    assert not history.has_night(database, replace(one, elapsed=one.elapsed + 0.2))


def test_a_night_that_cannot_be_written_as_a_whole_is_not_there_at_all(database: sql.Engine) -> None:
    history.add_night(database, FIRST)
    broken = later(2, runs=(RUN, replace(RUN, wall_time=[1.0])))  # no number: the database refuses this row
    with pytest.raises(HistoryError, match="it is as it was before"):
        history.add_night(database, broken)
    assert len(history.list_nights(database)) == 1
    assert [len(history.ask(database, sql.select(t))) for t in (history.COMPARISON, history.TIMING)] == [1, 1]
    history.add_night(database, later(2))
    assert len(history.list_nights(database)) == 2


def test_a_locked_database_is_told_after_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "PATIENCE", 0.2)
    database = history.open_database(f"sqlite:///{tmp_path / 'h.sqlite'}")
    other = sqlite3.connect(tmp_path / "h.sqlite")
    other.execute("BEGIN EXCLUSIVE")
    with pytest.raises(HistoryError, match="database is locked"):
        history.add_night(database, FIRST)
    other.rollback()
    other.close()
    assert history.list_nights(database) == []
    history.add_night(database, FIRST)
    assert len(history.list_nights(database)) == 1


def test_what_is_no_database_says_so_without_its_password(tmp_path: Path) -> None:
    (tmp_path / "text.sqlite").write_text("not a database at all, only words" * 50)
    with pytest.raises(HistoryError, match=r"cannot open the history sqlite.*file is not a database"):
        history.open_database(f"sqlite:///{tmp_path / 'text.sqlite'}")
    with pytest.raises(HistoryError, match="cannot open the history"):
        history.open_database("no url at all")
    with pytest.raises(HistoryError) as caught:
        history.open_database("mysql+nothing://me:secret@host/nights")
    assert "secret" not in str(caught.value)


def test_metrics_of_benchmarks_have_limits_like_torques(database: sql.Engine) -> None:
    ratio = Metric("ur5 over Pinocchio", 1.3, "-", lower=1.0)
    assert [m.verdict for m in (ratio, replace(ratio, value=0.9), replace(ratio, upper=1.2))] == [
        *("within", "deviation", "deviation"),
    ]
    assert replace(ratio, lower=None).verdict == "unjudged"
    number = history.add_metrics(database, [ratio, replace(ratio, name="other", value=0.5)])
    assert [n.exit_code for n in history.list_nights(database, "bench")] == [1]
    assert {r["name"]: r["value"] for r in history.read_rows(database, history.METRIC, number)} == {
        "ur5 over Pinocchio": 1.3,
        "other": 0.5,
    }
    chart = trends.build_metric_charts(history.read_rows(database, history.METRIC, number), {number: 0})[1]
    assert (chart["title"], chart["lower"], chart["upper"]) == ("ur5 over Pinocchio", 1.0, None)


# ------------------------------------------------------------------------------------------------------------ changes


def difference(database: sql.Engine, after: Results) -> dict[str, object]:
    history.add_night(database, FIRST, "2026-03-01")
    number = history.add_night(database, after, "2026-03-02")
    before = changes.find_previous_night(database, number)
    assert before is not None
    return changes.collect_changes(database, before, number, Scope())


def test_nothing_changed(database: sql.Engine) -> None:
    result = difference(database, later(2, comparisons=(replace(ROW, maximum=2.03e-4),)))  # within noise
    assert change_summary.describe_changes(result) == "Since 2026-03-01: nothing changed."


def test_values_versions_models_and_times_that_changed_are_named(database: sql.Engine) -> None:
    worse = replace(ROW, maximum=2e-3, verdict="deviation")
    new = replace(ROW, quantity="tip", unit="m")
    runs = (replace(RUN, wall_time=5.0, model_hash="bb", version="4.1"),)
    result = difference(
        database, later(2, comparisons=(worse, new), runs=runs, versions={"mujoco": "4.1", "numpy": "2.3"})
    )
    assert result["versions"] == [{"package": "mujoco", "before": "4.0", "after": "4.1"}]
    assert result["models"] == ["arm/swing"]
    assert [(v["before"], v["after"], v["after_verdict"]) for v in result["values"]] == [(2e-4, 2e-3, "deviation")]
    assert result["appeared"] == ["arm/swing mujoco against flexinv: tip [m]"]
    assert result["slower"] == [{"run": "arm swing mujoco", "before": 2.0, "after": 5.0}]
    assert change_summary.describe_changes(result) == (
        "Since 2026-03-01: 1 new deviation, 1 comparison moved, 1 version changed (mujoco), 1 model changed (arm/swing), "
        "1 comparison appeared, 1 run slower."
    )


def test_causes_that_came_and_went_are_named_where_the_engine_ran_in_both(database: sql.Engine, tmp_path: Path) -> None:
    def because(cause: str, target: str, engine: str = "mujoco") -> Diagnosis:
        named = ({"cause": cause, "target": target, "words": f"{cause} of {target} differs", "left": 0.0},)
        return Diagnosis("arm", "swing", engine, "flexinv", named=named)

    new = replace(ROW, engine="exudyn")  # did not run before: what it differs for is no news of that engine's release
    history.add_night(database, replace(FIRST, diagnoses=(because("gravity", ""),)), "old")
    after = [because("rotor inertia", "hub"), because("gravity", "", "exudyn")]
    number = history.add_night(database, later(2, diagnoses=tuple(after), comparisons=(ROW, new)), "new")
    before = changes.find_previous_night(database, number)
    assert before is not None
    result = changes.collect_changes(database, before, number, Scope())
    assert [(c["what"], c["name"]) for c in result["causes"]] == [
        ("appeared", "arm/swing mujoco against flexinv: rotor inertia (hub)"),
        ("vanished", "arm/swing mujoco against flexinv: gravity"),
    ]
    assert result["causes"][0]["words"] == "rotor inertia of hub differs"
    told = "Since old: 1 cause appeared, 1 cause vanished, 1 comparison appeared."
    assert change_summary.describe_changes(result) == told
    assert (
        change_summary.describe_changes({k: v for k, v in result.items() if k != "causes"})
        == "Since old: 1 comparison appeared."
    )
    night = replace(FIRST, changes=result)
    assert "| appeared | arm/swing mujoco against flexinv: rotor inertia (hub) |" in markdown.render(night)
    page = html.prepare_templates().get_template("index.html.j2").render(**html.build_index_view(night, tmp_path))
    assert "cause vanished: <b>arm/swing mujoco against flexinv: gravity</b>" in page


def test_what_vanished_is_named_where_its_engine_ran(database: sql.Engine) -> None:
    other = replace(ROW, quantity="tip", unit="m")
    history.add_night(database, replace(FIRST, comparisons=(ROW, other)), "a")
    number = history.add_night(database, later(2), "b")
    before = changes.find_previous_night(database, number)
    assert before is not None
    assert changes.collect_changes(database, before, number, Scope())["vanished"] == [
        "arm/swing mujoco against flexinv: tip [m]"
    ]


def test_a_model_that_was_moved_away_has_vanished_unless_the_night_leaves_it_out(database: sql.Engine) -> None:
    history.add_night(database, replace(FIRST, comparisons=(ROW, replace(ROW, mechanism="leg"))), "a")
    number = history.add_night(database, later(2), "b")
    before = changes.find_previous_night(database, number)
    assert before is not None
    for scope, lost in ((Scope(), ["leg/swing mujoco against flexinv: torque [N m]"]), (Scope(("arm",)), [])):
        assert changes.collect_changes(database, before, number, scope)["vanished"] == lost


def test_the_night_before_is_the_last_ordinary_one_that_finished(database: sql.Engine) -> None:
    assert changes.find_previous_night(database, 1) is None
    numbers = [
        history.add_night(database, FIRST, "one"),
        history.add_night(database, later(2, finished=False), "two"),
        history.add_night(database, later(3), "three", "latest-engines"),
    ]
    history.add_metrics(database, [Metric("m", 1.0, "-")])
    now = history.add_night(database, later(5), "now")
    previous_night = changes.find_previous_night(database, now)
    assert (previous_night and previous_night.id, previous_night and previous_night.folder) == (numbers[0], "one")
    for wanted in ("three", "2026-03-03"):
        other = changes.find_previous_night(database, now, wanted)
        assert other is not None
        assert other.id == numbers[2]
    with pytest.raises(LookupError, match="no night is called 'monday'; the last ones are one, two, three"):
        changes.find_previous_night(database, now, "monday")


def test_trends_mark_the_versions_that_changed(database: sql.Engine, tmp_path: Path) -> None:
    for day in range(1, 6):
        history.add_night(database, later(day, versions={"mujoco": "4.0" if day < 4 else "4.1"}), f"n{day}")
    trends.write(database, tmp_path)
    text = (tmp_path / "trends" / "arm-swing.html").read_text()
    assert "mujoco 4.0 to 4.1" in text
    assert "2026-03-04" in text
    assert (tmp_path / "trends" / "index.html").is_file()


def test_a_database_of_somebody_else_is_refused_and_stays(tmp_path: Path) -> None:
    file = tmp_path / "mine.sqlite"
    with closing(sqlite3.connect(file)) as mine, mine:
        mine.execute("create table night (id integer primary key, dreams text)")
    before = file.read_bytes()
    with pytest.raises(HistoryError, match="its table night has no column key, so it is somebody else's"):
        history.open_database(f"sqlite:///{file}")
    assert file.read_bytes() == before
