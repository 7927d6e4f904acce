"""identify on logs whose truth is known: parameters, intervals, bands, and predictions that look at no torque."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import logged_arm
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from shown_rules import SVG, check_shown

import crosscheck
from crosscheck.cli import Main
from crosscheck.identification.bands import compute_margins, judge, predict
from crosscheck.identification.estimation.fit import Problem, _find_start_by_scan, build_problem, fit
from crosscheck.identification.excitation import find_exciting_motion
from crosscheck.identification.filters import low_pass
from crosscheck.identification.identified_file import write_identified
from crosscheck.identification.identify import Identification, judge_blocks, read_machine
from crosscheck.identification.logs.doubts import describe_log_doubts
from crosscheck.identification.logs.log import Log, read_log
from crosscheck.identification.parameters import Parameter, apply_values
from crosscheck.identification.readings import make_run
from crosscheck.identification.settings import read_settings
from crosscheck.output_folder import list_our_files
from crosscheck.verdicts.results import read
from flexinv.errors import ConvergenceError, InputError
from flexinv.files.load_mechanism import load_mechanism
from flexinv.rigid.joint_torques import joint_torques
from flexinv.typing import Array


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("models") / "arm"
    logged_arm.write_arm(base)
    for seed, name in enumerate(("one", "two")):
        logged_arm.frame(base, seed).to_csv(base / f"{name}.csv", index=False)
    return base


@pytest.fixture(scope="module")
def found(folder: Path) -> Identification:
    return crosscheck.identify(folder, [folder / "one.csv"], [folder / "two.csv"], days="one")


def test_the_truth_lies_in_the_intervals(found: Identification) -> None:
    """Friction and the static moment of the forearm, which its torque tells; 90 % intervals hold these with this seed."""
    table = {(row.parameter, row.place): row for row in found.parameters}
    for key, truth in ((("viscous friction", "shoulder"), 4.0), (("coulomb friction", "shoulder"), 2.0)):
        row = table[key]
        assert row.identifiable
        assert row.low < truth < row.high
        assert row.high - row.low < 0.2 * (row.before_high - row.before_low)


def test_what_no_torque_shows_keeps_its_prior(found: Identification) -> None:
    """Products of inertia of the upper arm with its axis: a joint on the ground never shows them."""
    for name in ("Ixy", "Iyz"):
        row = next(r for r in found.parameters if (r.parameter, r.place) == (name, "upper"))
        assert not row.identifiable
        assert any(name in words and words.startswith("upper") for words in found.words)


def test_an_unseen_motion_is_predicted_inside_its_bands(found: Identification) -> None:
    """Noise of 0.05 N m behind 10 Hz is 0.014 N m of torques of some 10 N m.

    Where a joint turns round, its band has the width of dry friction, 4 N m here: widths are asked of joints that go on.
    """
    for row in found.judged:
        assert row.explained > 0.999
        assert 0.8 < row.coverage < 0.99
    run, told = found.held[0]
    for row in judge(found.machine, run, told, run.counted & (np.abs(run.motion.qd) > 0.2)):
        assert 0.8 < row.coverage < 0.99
        assert row.width < 5.0


def test_blocks_judge_each_other(folder: Path, found: Identification) -> None:
    for row in judge_blocks(found.machine, read_log(folder / "one.csv"), 4):
        assert row.explained > 0.999
        assert row.coverage > 0.75  # of four blocks, a quarter of the log each


def run(*arguments: str) -> str:
    done = CliRunner().invoke(Main(), ["identify", *arguments])
    assert done.exit_code == 0, done.output
    return done.output


def test_a_prediction_looks_at_no_torque(folder: Path, tmp_path: Path) -> None:
    """Without the torque columns of the other log the file is the same, bit by bit."""
    models = ["--models", str(folder.parent)]
    log = pd.read_csv(folder / "two.csv", dtype=str)  # numbers stay as they are written
    log.drop(columns=["t1", "t2"]).to_csv(tmp_path / "without.csv", index=False)
    files = []
    for name, log in (("a", folder / "two.csv"), ("b", tmp_path / "without.csv")):
        run("arm", *models, "--log", "one.csv", "--predict", str(log), "--out", str(tmp_path / name))
        files.append((tmp_path / name / "prediction.csv").read_bytes())
    assert files[0] == files[1]
    table = pd.read_csv(tmp_path / "a" / "prediction.csv")
    assert list(table.columns)[:4] == [
        "time_s", "torque/shoulder [N m]", "torque/shoulder low [N m]", "torque/shoulder high [N m]",
    ]  # fmt: skip
    assert np.array_equal(table["time_s"], pd.read_csv(folder / "two.csv")["time_s"])
    heads = pd.read_csv(tmp_path / "a" / "parameters.csv").columns
    assert list(heads) == ["parameter", "place", "value", "low", "high", "unit", "identifiable"]
    days = pd.read_csv(tmp_path / "a" / "days.csv")
    assert list(days.columns) == ["parameter", "place", "day", "value", "low", "high", "unit"]
    assert set(days["day"]) == {"one.csv", "mean of days"}


def test_every_log_that_is_asked_for_is_predicted(folder: Path, tmp_path: Path) -> None:
    logs = [str(folder / "one.csv"), str(folder / "two.csv")]
    asked = [word for log in logs for word in ("--predict", log)]
    said = run(
        "arm", f"{logs[0]}@0:4", "--models", str(folder.parent), *asked, "--out", str(tmp_path / "both")
    )  # a log behind the name identifies, as --log does
    files = [tmp_path / "both" / name for name in ("prediction.csv", "prediction_2.csv")]
    for file, log in zip(files, logs, strict=True):
        assert np.array_equal(pd.read_csv(file)["time_s"], pd.read_csv(log)["time_s"])
        assert f"prediction of {Path(log).name}: {file}" in said
    assert files[0].read_bytes() != files[1].read_bytes()


def test_no_log_at_all_is_refused_in_words(folder: Path) -> None:
    done = CliRunner().invoke(Main(), ["identify", "arm", "--models", str(folder.parent)])
    assert done.exit_code == 2
    assert "no log, expected one that identifies; write crosscheck identify arm run.csv" in done.output


@pytest.mark.parametrize("good", [1, 0])
def test_a_start_whose_march_fails_is_none(folder: Path, found: Identification, good: int) -> None:
    """Of the first start and four others one marches, or none: the one is taken, and that is said in keys of identify.toml."""
    machine = read_machine(folder)
    stiff = Parameter("joint stiffness", "elbow", "N m/rad", 1.0, 0.1, True)
    space = replace(machine.space, parameters=(stiff,))
    tried: list[float] = []

    class Marched(Problem):
        def predict(self, z: Array) -> list[Array]:
            tried.append(float(z[0]))
            if len(tried) == 3 and good:
                return [run.measured + 1.0 for run in self.runs if run.measured is not None]
            raise ConvergenceError("mechanism 'arm', at t = 1 s: it has left the motion; write step = 1e-4")

    task = Marched(replace(machine, space=space), found.task.runs, found.task.chosen, found.task.every)
    measured = task.collect_counted_samples([run.measured for run in task.runs if run.measured is not None])
    if good:
        assert _find_start_by_scan(task, measured, np.zeros(1)) == [tried[2]]
        assert len(tried) == 5
        return
    with pytest.raises(InputError, match=r"at t = 1 s: it has left the motion\); write every = 2 or more") as caught:
        _find_start_by_scan(task, measured, np.zeros(1))
    assert "step = " not in str(caught.value)


def test_figures_stand_where_nothing_was_judged(folder: Path, tmp_path: Path) -> None:
    """No [[limits]]: no tick, but how much is told, explained and covered; both logs that are held out are drawn."""
    out = tmp_path / "out"
    logs = [str(folder / "one.csv"), str(folder / "two.csv")]
    held = ["--hold-out", f"{logs[1]}@0:4", "--hold-out", f"{logs[1]}@4:8"]
    run("arm", "--models", str(folder.parent), "--log", logs[0], *held, "--out", str(out))
    head = (out / "summary.md").read_text().splitlines()[0]
    told = sum(row.identifiable for row in crosscheck.identify(folder, logs[:1]).parameters)
    assert head.startswith(f"# Nothing was judged. {told} of 26 parameters told by the logs; held out: 2 channels, ")
    assert re.search(r"[\d.]+ % explained at least .*, [\d.]+ % of samples inside 90 % bands at least", head)
    page = (out / "index.html").read_text()
    for text in ((out / "summary.md").read_text(), page):
        assert "From day to day 20 % of the viscous friction, 15 % of the dry friction and an offset of 5 %" in text
    assert "write [[limits]] into identify.toml.</p>" in page  # and no word of a log to hold out: two are
    assert 0.1 < read(out / "results.json").elapsed < 1e3  # [s]
    assert '<p class="sign" aria-hidden="true">–</p>' in page
    assert "✓" not in page.partition('<section class="hero')[2].partition("</section>")[0]
    figures = [one["title"] for one in read(out / "results.json").studies[0].figures]
    for channel in ("torque/shoulder", "torque/elbow"):
        drawn = [title for title in figures if title.startswith(channel)]
        assert [part in title for part, title in zip(("[0:4]", "[4:8]"), drawn, strict=True)] == [True, True]
    assert sum(title.startswith("What remains, by frequency") for title in figures) == 2


def test_a_copy_as_hold_out_is_said(folder: Path) -> None:
    words = crosscheck.identify(folder, [folder / "one.csv"], [folder / "one.csv"]).words
    assert any("no test" in text for text in words)


def test_a_doubled_column_is_refused(folder: Path, tmp_path: Path) -> None:
    text = (folder / "one.csv").read_text().replace("q2", "q1", 1)
    (tmp_path / "twice.csv").write_text(text)
    with pytest.raises(InputError, match="stands there twice"):
        crosscheck.identify(folder, [tmp_path / "twice.csv"])


def test_a_clipped_torque_is_said(folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(folder / "one.csv")
    table["t1"] = table["t1"].clip(upper=float(np.quantile(table["t1"], 0.9)))
    table.to_csv(tmp_path / "clipped.csv", index=False)
    assert any("clipped" in words for words in crosscheck.identify(folder, [tmp_path / "clipped.csv"]).words)


def test_a_format_that_cannot_be_read_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "run.xyz").write_bytes(b"x")
    with pytest.raises(InputError, match="format unknown"):
        read_log(tmp_path / "run.xyz")


def test_a_parquet_file_is_read_or_says_what_it_needs(folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(folder / "one.csv")
    try:
        table.to_parquet(tmp_path / "one.parquet")
    except ImportError:
        (tmp_path / "one.parquet").write_bytes(b"PAR1")
        with pytest.raises(InputError, match="pip install pyarrow"):
            read_log(tmp_path / "one.parquet")
        return
    assert np.array_equal(read_log(tmp_path / "one.parquet").read_column("t1"), table["t1"])


def test_a_mat_file_is_read(folder: Path, tmp_path: Path) -> None:
    from scipy.io import savemat

    table = pd.read_csv(folder / "one.csv")
    savemat(tmp_path / "one.mat", {name: table[name].to_numpy() for name in table.columns})
    log = read_log(tmp_path / "one.mat")
    assert np.array_equal(log.read_column("t1"), table["t1"])


@pytest.mark.parametrize("damaged", [b"hello", bytes(range(256)) * 8])
def test_a_damaged_mat_file_is_one_error(damaged: bytes, tmp_path: Path) -> None:
    (tmp_path / "one.mat").write_bytes(damaged)
    with pytest.raises(InputError, match=r"one\.mat: no MAT file that can be read .*; save it anew, or export CSV"):
        read_log(tmp_path / "one.mat")


def test_logs_that_overlap_and_other_rates_are_said(folder: Path) -> None:
    log = folder / "one.csv"
    machine = read_machine(folder)
    half = [read_log(f"{log}@0:5"), read_log(f"{log}@4:8")]
    assert any("hold the same samples over 0.996 s" in words for words in describe_log_doubts(machine, half, []))
    one, two = read_log(log), read_log(folder / "two.csv")
    other = Log("every second", two.time[::2], {k: v[::2] for k, v in two.columns.items()})
    assert any("sampled at 125 Hz" in words for words in describe_log_doubts(machine, [one, other], []))
    assert describe_log_doubts(machine, [one, two], []) == []


@pytest.mark.parametrize(
    ("line", "instead", "says"),
    [
        ('parameter = "viscous friction"', 'parameter = "viscous fricton"', 'write parameter = "viscous friction"'),
        (
            'parameter = "viscous friction"',
            'parameter = "beam stiffness"',
            "expected a mechanism that has a place for it",
        ),
        ('parameter = "viscous friction"', 'parameter = "backlash"', "read off two encoders"),
        ('parameter = "viscous friction"', 'parameter = "torque constant"', 'write parameter = "effort gain"'),
        ("[[free]]", '[night]\nlog = ["one.csv"]\n[[free]]', "one of them: what judges"),
        ("relative = 0.3", "relative = 0", "greater than 0"),
        ("still_rad_per_s = 0.02", "still_rad_per_s = 0", r"key still_rad_per_s(.|\n)*greater than 0"),
        ("error = 0.5", "error = 0.0", "greater than 0"),
        ('parameter = "viscous friction"', 'parameter = "joint stiffness"', "nothing is known of it before"),
        ("[joints.elbow]", "[joints.elbo]", r"\[joints.elbow\]"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_in_words(tmp_path: Path, line: str, instead: str, says: str) -> None:
    base = logged_arm.write_arm(tmp_path / "arm")
    text = (base / "identify.toml").read_text()
    assert line in text
    (base / "identify.toml").write_text(text.replace(line, instead, 1))
    with pytest.raises(InputError, match=says):
        read_machine(base)


def test_torsion_is_a_parameter_apart_from_bending(root: Path) -> None:
    """GJ takes both factors, EI the one of the beam."""
    arm = load_mechanism(root / "models" / "spatial_arm")
    name = arm.beams[0].name
    changed = apply_values(arm, {("beam stiffness", name): 2.0, ("torsion stiffness", name): 1.5})
    before, after = (m.link_of[name].beam.section.stiffness for m in (arm, changed))  # type: ignore[union-attr]
    assert np.allclose(after / before, [2.0, 2.0, 2.0, 3.0, 2.0, 2.0], rtol=1e-12)  # rounding


def test_a_parameter_that_nothing_shows_keeps_its_prior_in_words(folder: Path, tmp_path: Path) -> None:
    base = logged_arm.write_arm(tmp_path / "arm")
    text = (base / "identify.toml").read_text()
    free = '[[free]]\nparameter = "gravity tilt x"\nerror = 0.01\n'
    (base / "identify.toml").write_text(text + free.replace("tilt x", "tilt y") + free)
    identification = crosscheck.identify(base, [folder / "one.csv"])
    row = next(r for r in identification.parameters if r.parameter == "gravity tilt x")
    assert not row.identifiable
    assert any(words.startswith("world: ") and "gravity tilt x" in words for words in identification.words)


def test_an_identification_shows_parameters_with_intervals_and_a_reading(found: Identification) -> None:
    tree = check_shown(found)
    row = next(row for row in found.parameters if row.identifiable)
    line = next(line for line in repr(found).splitlines() if line.strip().startswith(f"{row.parameter} "))
    assert f"{row.value:.4g} {row.unit}" in line
    assert f"{row.low:.4g} to {row.high:.4g} {row.unit}" in line
    assert "held out" in repr(found)
    (picture,) = tree.iter(f"{SVG}svg")
    assert [one.text for one in picture.iter(f"{SVG}text")][-2:] == ["measured", "told"]


def test_what_was_identified_loads_like_any_mechanism(folder: Path, found: Identification, tmp_path: Path) -> None:
    """Its torques with rotors and friction are those that were predicted, less the offsets of the sensors."""
    write_identified(found, folder / "mechanism.toml", tmp_path / "identified.toml")
    arm = load_mechanism(tmp_path / "identified.toml")
    assert arm.name == "arm"
    assert "identified from one.csv" in arm.source
    run, told = found.held[0]
    table = {(row.parameter, row.place): row.value for row in found.parameters}
    assert arm.joint_of["shoulder"].damping == pytest.approx(table["viscous friction", "shoulder"])
    motion = run.motion
    torque = joint_torques(arm, motion.q, motion.qd, motion.qdd, passive=False)
    for k, name in enumerate(("shoulder", "elbow")):
        v, joint = motion.qd[:, k], arm.joint_of[name]
        drive = joint.damping * v + joint.friction * np.tanh(v / 0.02)
        own = low_pass(torque[:, k] + drive + table["effort offset", name], 0.004, 10.0)
        assert np.abs(own - told.value[:, k]).max() < 1e-6 * np.ptp(own)  # nine digits are written
    text = (tmp_path / "identified.toml").read_text()
    assert all(low != high for low, high in re.findall(r"90 %: (\S+) to (\S+)", text))
    assert "before 3" in text
    assert "effort offset of shoulder" in text


def test_a_page_says_it_all_and_limits_decide(folder: Path, tmp_path: Path) -> None:
    base = logged_arm.write_arm(tmp_path / "models" / "arm")
    text = (base / "identify.toml").read_text()
    files = [str(folder / "one.csv"), str(folder / "two.csv")]
    codes = []
    for least in (0.9, 0.99999999):
        (base / "identify.toml").write_text(f'{text}[[limits]]\nchannel = ["torque/*"]\nexplained = {least}\n')
        out = tmp_path / f"out{least}"
        done = CliRunner().invoke(
            Main(),
            [
                "identify",
                "arm",
                "--models",
                str(base.parent),
                "--log",
                files[0],
                "--hold-out",
                files[1],
                "--out",
                str(out),
            ],
        )
        codes.append(done.exit_code)
    assert {"parameters.csv", "judged.csv", "identified.toml"} <= list_our_files(out)  # a third run may write over them
    assert codes == [0, 1]
    junit = (out / "junit.xml").read_text()
    assert 'failures="2"' in junit
    assert "expected 1 or more" in junit or "expected 0.99999999" in junit
    page = next((out / "studies").glob("*.html")).read_text()
    for words in (
        "Parameters before and after",
        "What cannot be told",
        "From run to run",
        "What remains, by frequency",
    ):
        assert words in page
    assert "Parameters before and after" in (out / "index.html").read_text()  # a run that is one study: no click away


def test_a_proposed_motion_tells_more_and_keeps_the_limits(folder: Path, found: Identification) -> None:
    log = read_log(folder / "one.csv")
    proposal = find_exciting_motion(found.machine, found.fit, log, 8.0)
    seen = found.shown[0][0].motion
    assert np.all(np.ptp(proposal.q, axis=0) <= np.ptp(seen.q, axis=0))
    rate = np.gradient(proposal.q, proposal.time, axis=0)
    assert np.all(np.abs(rate).max(axis=0) <= np.abs(seen.qd).max(axis=0))
    assert np.abs(rate[[0, -1]]).max() < 1e-3
    assert any("no motion that was tried tells" in words and "upper" in words for words in proposal.words)


def test_a_first_identify_toml_is_proposed(folder: Path, tmp_path: Path) -> None:
    """Columns by joint name, number and unit; the proposal identifies at once."""
    base = logged_arm.write_arm(tmp_path / "models" / "arm")
    (base / "identify.toml").unlink()
    names = {"q1": "shoulder_angle_deg", "q2": "elbow_angle_deg", "t1": "torque1 [N m]", "t2": "torque2 [N m]"}
    table = pd.read_csv(folder / "one.csv")
    table[["q1", "q2"]] = np.degrees(table[["q1", "q2"]])
    table.rename(columns=names | {"time_s": "Time [s]"}).to_csv(tmp_path / "log.csv", index=False)
    run("arm", "--models", str(base.parent), "--log", str(tmp_path / "log.csv"), "--propose")
    settings = read_settings(base, load_mechanism(base))
    assert settings.joints["elbow"].angle.column == "elbow_angle_deg"
    assert settings.joints["elbow"].angle.unit == "deg"
    assert settings.time == "Time [s]"
    assert settings.joints["shoulder"].effort is not None
    assert settings.joints["shoulder"].effort.column == "torque1 [N m]"
    widths = {tuple(f.place): f.relative for f in settings.free if f.parameter == "mass properties"}
    assert widths == {("*",): 0.2, ("fore",): pytest.approx(np.log1p(0.1 * 8.4 / 2.4), rel=0.01)}
    identification = crosscheck.identify(base, [tmp_path / "log.csv"])
    assert all(row.explained > 0.99 for row in identification.seen)
    done = CliRunner().invoke(
        Main(), ["identify", "arm", "--models", str(base.parent), "--log", str(tmp_path / "log.csv"), "--propose"]
    )
    assert done.exit_code == 2
    assert "is there already" in done.output


@pytest.mark.parametrize(("constant", "written"), [(0.06, False), (9.0, True)])
def test_currents_are_explained_whether_or_not_somebody_knows_their_constant(
    folder: Path, tmp_path: Path, constant: float, written: bool
) -> None:
    """The proposal takes 1 N m/A; friction that it states in amperes must not hold the fit when the constant is written."""
    base = logged_arm.write_arm(tmp_path / "models" / "arm")
    text = (base / "mechanism.toml").read_text()
    bare = [line for line in text.splitlines() if not line.startswith(("damping", "friction", "rotor"))]
    (base / "mechanism.toml").write_text("\n".join(bare))
    (base / "identify.toml").unlink()
    for name in ("one", "two"):
        table = pd.read_csv(folder / f"{name}.csv")
        table[["t1", "t2"]] /= constant
        names = {"q1": "shoulder_angle_rad", "q2": "elbow_angle_rad", "t1": "current1 [A]", "t2": "current2 [A]"}
        table.rename(columns=names).to_csv(tmp_path / f"{name}.csv", index=False)
    run("arm", "--models", str(base.parent), "--log", str(tmp_path / "one.csv"), "--propose")
    proposed = (base / "identify.toml").read_text()
    assert proposed.count('parameter = "effort gain"') == 2
    if written:
        tables = proposed.replace("constant_Nm_per_A = 1.0", f"constant_Nm_per_A = {constant}").split("\n\n")
        kept = [table for table in tables if 'parameter = "effort gain"' not in table]
        (base / "identify.toml").write_text("\n\n".join(kept))
    found = crosscheck.identify(base, [tmp_path / "one.csv"], [tmp_path / "two.csv"])
    assert all(row.explained > 0.998 for row in found.judged)


@pytest.mark.slow
def test_four_fifths_of_the_measured_arm_predict_the_last(root: Path) -> None:
    """Motor torques of kuka_kr300: 99 % on axes 1 to 3 and 95 % on 4 to 6 is what its record is kept for."""
    folder = root / "models" / "kuka_kr300"
    machine = read_machine(folder)
    run = make_run(machine, read_log(folder / "run_A.csv.gz"))
    last = (run.time >= 6.92)[:, None]
    task = build_problem(machine, (run,), (run.counted & ~last,))
    result = fit(task)
    told = predict(machine, result, compute_margins(task, result), run)
    seen = judge(machine, run, told, run.counted & ~last)
    assert all(row.explained > 0.99 for row in seen[:3])
    assert all(row.explained > 0.95 for row in seen[3:])
    unseen = judge(machine, run, told, run.counted & last)
    # of one block alone: errors over the spread of the whole window
    for c, row in enumerate(unseen):
        spread = run.measured[run.counted[:, c], c].std()  # type: ignore[index]
        assert 1.0 - (row.rms / spread) ** 2 > (0.99 if c < 3 else 0.95)
        assert row.coverage > 0.7  # of 90 % on average over blocks
