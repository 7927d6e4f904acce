"""The page of an identification: what was asked for comes first, and nothing on it is cut, also on narrow screens."""

from __future__ import annotations

import re
from pathlib import Path

import chromium
import logged_arm
import pandas as pd
import pytest
import uncut

import crosscheck
from crosscheck.identification.page import write_page
from crosscheck.verdicts.results import read

page = pytest.fixture(scope="module")(chromium.lend_page)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("page")
    folder = logged_arm.write_arm(base / "arm")
    for seed, name in enumerate(("one", "two")):
        logged_arm.frame(folder, seed).to_csv(folder / f"{name}.csv", index=False)
    found = crosscheck.identify(folder, [folder / "one.csv"], [folder / "two.csv"])
    (base / "out").mkdir()
    write_page(found, [], "crosscheck identify arm", base / "out", 12.34)
    return base / "out"


def test_parameters_come_first_then_how_well_logs_are_explained(out: Path) -> None:
    text = (out / "index.html").read_text()
    titles = re.findall(r"<h2>(.*?)</h2>", text.split("arm, identified", 1)[1])
    assert titles[:2] == ["Parameters before and after", "How well the logs are explained"]
    assert "Parameters that the logs do not tell" in titles[2:]
    first = text.split("<h2>Parameters before and after", 1)[1].split("<h2>How well the logs", 1)[0]
    assert "viscous friction" in first
    assert "Ixy" not in first  # that of the upper arm no torque shows: it stands further below


def test_intervals_show_their_width(out: Path) -> None:
    """Two digits made "4 to 4" of the interval of a friction that the log tells well."""
    rows = read(out / "results.json").studies[0].tables[0]["rows"]
    assert len(rows) > 5
    for row in rows:
        low, high = row["interval"].split(" to ")
        assert low != high
        assert float(low) <= float(row["value"]) <= float(high)


def read_exactly(file: Path) -> pd.DataFrame:
    """Return a table with every digit of its numbers, as Python reads them."""
    return pd.read_csv(file, dtype=str).map(float)


def test_the_numbers_of_every_picture_lie_beside_it(out: Path) -> None:
    files = re.findall(r'href="(data/[^"]+\.csv)" download', (out / "index.html").read_text())
    names = [
        "1_two_csv_torque_shoulder", "2_two_csv_torque_elbow", "3_two_csv_errors_over_time", "4_one_csv_friction_shoulder",
        "5_one_csv_angle_shoulder", "6_one_csv_friction_elbow", "7_one_csv_angle_elbow", "8_two_csv_what_remains",
    ]  # fmt: skip
    assert [Path(file).stem for file in files] == names
    tables = [read_exactly(out / file) for file in files]
    assert [list(table)[:2] for table in tables[:2]] == [
        ["time [s]", f"two.csv, measured: torque/{joint} [N m]"] for joint in ("shoulder", "elbow")
    ]
    assert next(iter(tables[-1])) == "frequency [Hz]"
    assert not any(table.isna().any(axis=None) for table in tables)


def test_the_numbers_are_all_samples_of_the_log_with_all_digits(out: Path) -> None:
    """The page draws every second sample with five digits, and their files had no more."""
    log = read_exactly(out.parent / "arm" / "two.csv")
    drawn = read(out / "results.json").studies[0].figures[1]
    file = next(out.glob(f"data/*/{drawn['table']}.csv"))
    table = read_exactly(file)
    assert list(table["time [s]"]) == list(log["time_s"])
    predicted = drawn["curves"]["predicted"]
    every = table["two.csv, predicted: torque/elbow [N m]"][:: len(log) // len(predicted["x"])]
    assert 400 < len(predicted["x"]) < len(log)
    assert predicted["y"] == [float(f"{value:.5g}") for value in every]
    assert (predicted["y"] != every).mean() > 0.9


@pytest.mark.browser
@pytest.mark.parametrize(("width", "dark"), [(1400, False), (500, True)])
def test_nothing_is_cut(page: chromium.Browser, out: Path, width: int, dark: bool) -> None:
    """On a wide screen all tables have their rows; on a narrow one rows are cards, each value beside the title of its column."""
    page.open(f"file://{out / 'index.html'}", width, dark=dark)
    page.wait("document.querySelectorAll('.plot[data-drawn]').length === 8")
    assert uncut.list_cut(page) == []
    assert page.evaluate("!!document.querySelector('.stacked')") == (width == 500)
    assert page.complaints() == []
