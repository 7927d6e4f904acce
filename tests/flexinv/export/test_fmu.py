"""FMUs of inverse dynamics: what FMPy thinks of them, and the torques of the functions of Python, by both versions of FMI."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_library import needs_compiler
from click.testing import CliRunner
from fmu_driver import DrivenFmu, driven, needs_fmpy
from four_bar_example import TURN, four_bar
from marched_library import STEP, Rows, controlled, swing

import flexinv
from flexinv.cli.commands import app
from flexinv.errors import InputError
from flexinv.export.c_files import make_constants
from flexinv.export.fmu import compile_fmu
from flexinv.export.kernel_objects import make_kernel_object
from flexinv.export.library_plan import LibraryPlan
from flexinv.export.link_library import C_OPTIONS
from flexinv.export.machine_code import Processor, write_entries
from flexinv.model.links import Body, Inertia
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

pytestmark = [needs_compiler, needs_fmpy]
VERSIONS = ("3.0", "2.0")
ABUSE = Path(__file__).resolve().parents[2] / "shared" / "fmu" / "abuse.c"
# Two equilibria found in other ways, as in test_flexible_library.
REST = 1e-9
ROUNDING = 1e-14  # of a payload that is added as a body of its own: sums in another order
LOAD = Inertia(2.0, np.array([0.02, -0.01, 0.05]), np.diag([0.01, 0.02, 0.015]))
NUMBERS = (
    "mass",
    "centre.x",
    "centre.y",
    "centre.z",
    *(f"inertia.{axis}" for axis in ("xx", "yy", "zz", "xy", "xz", "yz")),
)


@pytest.fixture(scope="module")
def rigid() -> Mechanism:
    return flexinv.load_mechanism("models/rigid_3r")


@pytest.fixture(scope="module")
def bending() -> Mechanism:
    return replace(flexinv.load_mechanism("models/flex_two_link"), gravity=np.array([0.0, -9.81, 0.0]))


@pytest.fixture(scope="module")
def files(rigid: Mechanism, bending: Mechanism, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs of an arm that is rigid, and of one that bends, by both versions."""
    folder = tmp_path_factory.mktemp("fmus")
    made = dict[str, Path]()
    for fmi in VERSIONS:
        last = rigid.links[-1].name
        made[f"rigid {fmi}"] = flexinv.export_fmu(rigid, folder / f"rigid{fmi}.fmu", fmi=fmi, payloads=(last,))
        made[f"bending {fmi}"] = flexinv.export_fmu(
            bending, folder / f"bending{fmi}.fmu", fmi=fmi, step=STEP, payloads=("link2",)
        )
    return made


def find_problems(file: str) -> list[str]:
    """What the validation of FMPy says."""
    return list(importlib.import_module("fmpy.validation").validate_fmu(file))


def name_inputs(mechanism: Mechanism) -> list[str]:
    parts = [f"{name}.q" for name in mechanism.coordinate_names]
    return parts + [f"{name}.{part}" for part in ("qd", "qdd") for name in mechanism.velocity_names]


def name_outputs(mechanism: Mechanism) -> list[str]:
    return [f"{name}.tau" for name in mechanism.velocity_names]


def load_parameters(link: str, load: Inertia) -> dict[str, float]:
    i = load.tensor
    numbers = [load.mass, *load.com, i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    return {f"{link}.payload.{name}": float(one) for name, one in zip(NUMBERS, numbers, strict=True)}


def join_rows(rows: Rows) -> Array:
    return np.array([np.concatenate(row) for row in rows])


def replay(fmu: DrivenFmu, mechanism: Mechanism, rows: Rows, step: float = STEP) -> Array:
    return fmu.replay(name_inputs(mechanism), join_rows(rows), name_outputs(mechanism), step)


@pytest.mark.parametrize("kind", ["rigid", "bending"])
@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_validation_of_fmpy_finds_nothing(files: dict[str, Path], kind: str, fmi: str) -> None:
    file = str(files[f"{kind} {fmi}"])
    assert find_problems(file) == []
    said = importlib.import_module("fmpy").read_model_description(
        file, validate_variable_names=True, validate_model_structure=True
    )
    assert said.fmiVersion == fmi
    assert not said.coSimulation.canHandleVariableCommunicationStepSize
    assert said.coSimulation.canGetAndSetFMUstate
    assert said.coSimulation.canSerializeFMUstate
    assert "END of the" in said.description
    units = {one.name.rpartition(".")[2]: one.unit for one in said.modelVariables if one.name.startswith("joint1")}
    assert units == {
        "q": "rad", "qd": "rad/s", "qdd": "rad/s2", "tau": "N.m", "friction": "N.m", "damping": "N.m.s/rad"
    }  # fmt: skip


@pytest.mark.parametrize("fmi", VERSIONS)
def test_torques_of_a_rigid_arm_are_those_of_python(files: dict[str, Path], rigid: Mechanism, fmi: str) -> None:
    """Digit by digit; and with a payload, another gravity and friction, of which each is felt."""
    rows = swing(rigid, rigid.neutral + 0.3, steps=20)
    expected = np.array([flexinv.joint_torques(rigid, *row) for row in rows])
    with driven(files[f"rigid {fmi}"]) as fmu:
        fmu.begin({})
        assert np.array_equal(replay(fmu, rigid, rows, step=0.01), expected)
    last = rigid.links[-1].name
    gravity = np.array([1.0, -2.0, -9.0])
    heavy = replace(rigid.with_body(last, Body("load", LOAD)), gravity=gravity)
    drawn = np.array([flexinv.joint_torques(heavy, *row) for row in rows])
    drawn[:, 1] += (0.5 - rigid.drive_table[1, 1]) * np.array([qd[1] for _, qd, _ in rows])
    settings = {"joint2.damping": 0.5, "gravity.x": 1.0, "gravity.y": -2.0, "gravity.z": -9.0} | load_parameters(
        last, LOAD
    )
    with driven(files[f"rigid {fmi}"]) as fmu:
        fmu.begin(settings)
        result = replay(fmu, rigid, rows, step=0.01)
    np.testing.assert_allclose(result, drawn, rtol=0, atol=ROUNDING * np.ptp(drawn))
    assert np.abs(drawn - expected).max() > 0.1 * np.ptp(expected)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_steps_of_an_arm_that_bends_are_those_of_a_controller(
    files: dict[str, Path], bending: Mechanism, fmi: str
) -> None:
    """Digit by digit from the start of the export, elsewhere from an equilibrium that the FMU finds."""
    for start, bar in ((bending.neutral, 0.0), (np.array([0.4, -0.7]), REST)):
        rows = swing(bending, start)
        expected = controlled(bending, start, rows)
        with driven(files[f"bending {fmi}"]) as fmu:
            fmu.begin({f"{name}.q": one for name, one in zip(bending.coordinate_names, start, strict=True)})
            result = replay(fmu, bending, rows)
            tip = np.array(fmu.get("link2.tip.x", "link2.tip.y"))
            deflection = np.array(fmu.get("link2.deflection.x", "link2.deflection.y"))
        np.testing.assert_allclose(result, expected, rtol=0, atol=bar * np.ptp(expected))
        assert 0.0 < np.linalg.norm(deflection) < 0.1
        assert np.linalg.norm(tip) > 0.1


def test_a_payload_of_the_start_is_in_the_equilibrium(files: dict[str, Path], bending: Mechanism) -> None:
    load = Inertia(0.02, np.array([0.01, 0.02, 0.0]), np.diag([1e-5, 1e-5, 2e-5]))
    heavy = bending.with_body("link2", Body("load", load, 1.0))
    rows = swing(heavy, heavy.neutral, steps=20)
    expected = controlled(heavy, heavy.neutral, rows)
    with driven(files["bending 3.0"]) as fmu:
        fmu.begin(load_parameters("link2", load))
        result = replay(fmu, bending, rows)
    np.testing.assert_allclose(result, expected, rtol=0, atol=REST * np.ptp(expected))


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_state_is_kept_packed_and_brought_back(files: dict[str, Path], bending: Mechanism, fmi: str) -> None:
    """In the same instance, and as bytes in another one: the same digits again."""
    rows = swing(bending, bending.neutral, steps=30)
    table = join_rows(rows)
    names = name_inputs(bending), name_outputs(bending)
    with driven(files[f"bending {fmi}"]) as fmu, driven(files[f"bending {fmi}"]) as other:
        fmu.begin({})
        fmu.replay(names[0], table[:10], names[1], STEP)
        state = fmu.keep()
        packed = fmu.pack(state)
        first = fmu.replay(names[0], table[10:], names[1], STEP, 10)
        fmu.restore(state)
        assert np.array_equal(fmu.replay(names[0], table[10:], names[1], STEP, 10), first)
        other.begin({})
        unpacked = other.unpack(packed)
        other.restore(unpacked)
        assert np.array_equal(other.replay(names[0], table[10:], names[1], STEP, 10), first)
        other.free(unpacked)
        fmu.free(state)
        with pytest.raises(Exception, match="failed with status"):
            other.unpack(bytes(len(packed)))
    assert "these bytes are no state of this FMU" in other.said[-1]


@pytest.mark.parametrize("fmi", VERSIONS)
def test_what_cannot_be_is_refused_and_the_next_step_works(
    files: dict[str, Path], bending: Mechanism, fmi: str
) -> None:
    rows = swing(bending, bending.neutral, steps=30)
    table = join_rows(rows)
    names = name_inputs(bending), name_outputs(bending)
    with driven(files[f"bending {fmi}"]) as fmu:
        fmu.begin({})
        expected = fmu.replay(names[0], table, names[1], STEP)
    complaints = [
        ({}, (0.0, 2 * STEP), "the communication step is 0.004 s; this FMU takes 0.002 s alone"),
        ({}, (STEP, STEP), "the communication point is 0.002 s, but the FMU stands at 0 s"),
        ({}, (0.0, float("nan")), "are no finite numbers"),
        ({"joint1.q": float("nan")}, (0.0, STEP), "a number that is given is infinite or not a number"),
        (
            {"link2.payload.mass": -1.0},
            (0.0, STEP),
            "parameters: a mass, an inertia, friction or an index that cannot be",
        ),
        ({"gravity.z": 5.0}, (0.0, STEP), "gravity or a payload would leave the plane"),
    ]
    starts = {"joint1.q": 0.0, "link2.payload.mass": 0.0, "gravity.z": 0.0}
    with driven(files[f"bending {fmi}"]) as fmu:
        fmu.begin({})
        for values, step, said in complaints:
            fmu.set(values)
            with pytest.raises(Exception, match="failed with status 2"):  # discarded
                fmu.step(*step)
            assert said in fmu.said[-1]
            fmu.set({name: starts[name] for name in values})
        assert np.array_equal(fmu.replay(names[0], table, names[1], STEP), expected)
        with pytest.raises(Exception, match="failed with status 3"):
            fmu.set_numbers([10**6], [0.0])


@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("step", [None, 0.01])
def test_steps_of_a_rigid_arm_are_of_one_length(rigid: Mechanism, tmp_path: Path, fmi: str, step: float | None) -> None:
    """That of the export, or of the first step that was made, which a state brings along and a reset forgets."""
    file = flexinv.export_fmu(rigid, tmp_path / "arm.fmu", fmi=fmi, step=step)
    said = "this FMU takes 0.01 s alone" if step else "the first was 0.01 s: all are of one length"
    with driven(file) as fmu:
        stated = fmu.description.defaultExperiment.stepSize
        assert stated is None if step is None else float(stated) == step
        fmu.begin({}, start=1.0)
        state = fmu.keep()
        if step is None:
            fmu.step(1.0, 0.02)
            fmu.restore(state)
        for start in (1.0, 1.01):
            with pytest.raises(Exception, match="failed with status 2"):
                fmu.step(start + 0.5, 0.01)
            assert "the FMU stands at" in fmu.said[-1]
            fmu.step(start, 0.01)
            with pytest.raises(Exception, match="failed with status 2"):
                fmu.step(start + 0.01, 0.02)
            assert "the communication step is 0.02 s" in fmu.said[-1]
            assert said in fmu.said[-1]
        fmu.fmu.reset()
        fmu.begin({})
        if step is None:
            fmu.step(0.0, 0.02)
        fmu.free(state)


def test_loops_take_the_motion_of_all_joints(tmp_path: Path) -> None:
    """And say so where they do not close."""
    bar = four_bar()
    solution = flexinv.solve(bar, TURN, step=0.05, start={"B": 0.8, "D": 1.8})
    file = flexinv.export_fmu(bar, tmp_path / "bar.fmu", start=solution.q[0])
    table = np.hstack([solution.q, solution.qd, solution.qdd])
    with driven(file) as fmu:
        fmu.begin({})
        result = fmu.replay(name_inputs(bar), table, ["A.tau"], 0.05)
        expected = flexinv.prepare(bar).torques(solution.q, solution.qd, solution.qdd)[:, :1]
        np.testing.assert_allclose(result, expected, rtol=0, atol=ROUNDING * np.ptp(expected))
        fmu.set({"D.q": 0.0})
        with pytest.raises(Exception, match="failed with status 2"):
            fmu.step(1.05, 0.05)
    assert "do not keep the closed loops" in fmu.said[-1]
    assert "B.tau" not in fmu.places


HOSTILE = '"/><evil a="<&\'\x07\n]]>'


def test_hostile_names_stay_names(rigid: Mechanism, tmp_path: Path) -> None:
    joints = (replace(rigid.joints[0], name=HOSTILE), *rigid.joints[1:])
    file = flexinv.export_fmu(replace(rigid, name=HOSTILE, joints=joints), tmp_path / "x.fmu", fmi="2.0")
    assert find_problems(str(file)) == []
    with driven(file) as fmu:
        assert '"/><evil a="<&\'__]]>.q' in fmu.places
        assert not any("\n" in one.name for one in fmu.description.modelVariables)
    page = zipfile.ZipFile(file).read("documentation/index.html").decode()
    assert "<evil" not in page


def test_two_variables_of_one_name_are_refused(rigid: Mechanism, tmp_path: Path) -> None:
    last = rigid.links[-1].name
    with pytest.raises(InputError, match=f"two variables of the FMU would be '{last}.payload.mass'"):
        flexinv.export_fmu(rigid, tmp_path / "x.fmu", payloads=(last, last))
    joints = (replace(rigid.joints[0], name="a\x07"), replace(rigid.joints[1], name="a\n"), *rigid.joints[2:])
    with pytest.raises(InputError, match="both become A in C; rename one of them"):
        flexinv.export_fmu(replace(rigid, joints=joints), tmp_path / "x.fmu")


def test_bad_requests_are_refused_before_anything_is_written(
    rigid: Mechanism, bending: Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "arm.fmu"
    for words, said in (
        ({"fmi": "1.0"}, "fmi = '1.0'"),
        ({"kind": "sideways"}, "kind = 'sideways'"),
        ({"step": 0.0}, "step = 0"),
        ({"start": rigid.neutral}, "is rigid and has no state; leave out step and start"),
        ({"payloads": ("hand",)}, "payloads: there is no link 'hand'"),
        ({"target": "z80"}, "target = 'z80'"),
        ({"target": ["native"]}, r"target = \['native'\]"),
        ({"target": 3}, "target = 3"),
    ):
        with pytest.raises(InputError, match=said):
            flexinv.export_fmu(rigid, file, **words)
    with pytest.raises(InputError, match="is marched, and its motion carried on"):
        flexinv.export_fmu(bending, file)
    with pytest.raises(InputError, match=r"ends with .fmu; write out='arm.fmu'"):
        flexinv.export_fmu(rigid, tmp_path / "arm.zip")
    monkeypatch.setattr(compile_fmu, "find_compiler", lambda _: None)
    with pytest.raises(InputError, match="no C compiler was found to link one; install gcc or clang"):
        flexinv.export_fmu(rigid, file)
    assert not list(tmp_path.iterdir())
    file.write_text("of others")
    monkeypatch.undo()
    with pytest.raises(InputError, match="is there already"):
        flexinv.export_fmu(rigid, file)
    assert file.read_text() == "of others"


def test_an_fmu_carries_the_licence_and_is_the_same_every_time(
    rigid: Mechanism, files: dict[str, Path], root: Path, tmp_path: Path
) -> None:
    again = flexinv.export_fmu(rigid, tmp_path / "again.fmu", payloads=(rigid.links[-1].name,))
    assert again.read_bytes() == files["rigid 3.0"].read_bytes()
    for file in files.values():
        with zipfile.ZipFile(file) as archive:
            assert archive.read("documentation/licenses/license.txt").decode() == (root / "LICENSE").read_text()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_layer_has_the_declarations_of_the_standard(
    rigid: Mechanism, bending: Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmi: str
) -> None:
    """Compiled with the headers that FMPy ships, without a warning: a wrong type of one argument would be an error."""
    sources = list[tuple[str, str]]()
    headers = Path(str(importlib.import_module("fmpy").__file__)).parent / "c-code"

    def keep(_plan: object, source: tuple[str, str], name: str, _target: str) -> bytes:
        sources.append(source)
        (tmp_path / f"{name}.h").write_text(source[0])
        return b""

    monkeypatch.setattr("flexinv.export.export_fmu.build_library", keep)
    flexinv.export_fmu(bending, tmp_path / "x.fmu", fmi=fmi, step=STEP, payloads=("link2",))
    for kind, step in (("inverse", None), ("forward", STEP)):
        flexinv.export_fmu(rigid, tmp_path / "y.fmu", fmi=fmi, step=step, kind=kind, overwrite=True)
    name = f"fmi{fmi[0]}DoStep("
    wrong = sources[0][1].replace(name, name + "int extra, ")
    for text, fails in (*((source, False) for _, source in sources), (wrong, True)):
        (tmp_path / "fmu.c").write_text(text)
        words = ["cc", *C_OPTIONS, "-Werror", "-DFLEXINV_FMI_HEADERS", "-I.", f"-I{headers}", "-fsyntax-only", "fmu.c"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert bool(done.returncode) == fails, done.stderr


def has_sanitizers() -> bool:
    words = ["cc", "-fsanitize=address,undefined", "-x", "c", "-", "-o", "/dev/null"]
    return subprocess.run(words, input=b"int main(void) { return 0; }", capture_output=True).returncode == 0


@pytest.mark.skipif(not has_sanitizers(), reason="the C compiler has no sanitizers (libasan, libubsan)")
@pytest.mark.parametrize("kind", ["inverse", "forward"])
def test_an_abused_fmu_reads_and_writes_its_own_memory_alone(
    bending: Mechanism, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """The layer of FMI and the file of the library under the address and the undefined-behaviour sanitizer."""

    def keep(plan: LibraryPlan, source: tuple[str, str], name: str, target: str) -> bytes:
        processor = Processor.build_for(target)
        kernels = make_kernel_object(plan.entries, processor)
        entries = write_entries(plan.entries, make_constants(plan, name), processor, kernels.names)
        files = {f"{name}.h": source[0].encode(), "fmu.c": source[1].encode(), "k.o": kernels.code, "e.o": entries}
        for path, data in files.items():
            (tmp_path / path).write_bytes(data)
        return b""

    monkeypatch.setattr("flexinv.export.export_fmu.build_library", keep)
    flexinv.export_fmu(bending, tmp_path / "x.fmu", kind=kind, step=STEP, payloads=("link2",))
    shutil.copy(ABUSE, tmp_path)
    check = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    words = ["cc", "-std=c99", "-O1", *check, "abuse.c", "e.o", "k.o", "-lm", "-o", "abuse"]
    subprocess.run(words, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "abuse"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "refusals in words" in done.stdout


def test_the_command_line_writes_it(tmp_path: Path) -> None:
    file = tmp_path / "arm.fmu"
    done = CliRunner().invoke(app, ["export-fmu", "models/rigid_3r", "--out", str(file), "--fmi", "2.0"])
    assert done.exit_code == 0, done.output
    with driven(file) as fmu:
        assert not fmu.is_new
