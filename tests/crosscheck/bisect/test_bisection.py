"""A bisection over packages that the test makes: what is found, what is refused in which words, what goes on after a stop."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from local_index import UnzippingInstaller, write_wheel
from packaging.version import Version

from crosscheck.bisect.answer import Answer, make_answer
from crosscheck.bisect.bisection import Bisection, NotRepeatable, Plan
from crosscheck.bisect.criteria import Criterion
from crosscheck.bisect.environments import EnvironmentStore
from crosscheck.bisect.installers import InstallerError
from crosscheck.bisect.observations import Reading
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.releases import Release
from crosscheck.bisect.script import FLOOD, Script
from crosscheck.bisect.trials import STATE, Question, Trials
from flexinv.errors import InputError

VALUES = [1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0]  # heights of the releases 1.0 to 1.7
PYTHON = find_pythons([])[0]
HEIGHT = "import ball\nprint('height =', ball.height())\n"
FALL = "import ball\nassert ball.height() < 1.5, ball.height()\n"

Make = Callable[..., Bisection]


def write_ball(folder: Path, values: Sequence[float | str]) -> list[Release]:
    """Write releases of a package and return them; a text in the place of a value is its source."""
    releases = []
    for k, value in enumerate(values):
        source = value if isinstance(value, str) else f"def height():\n    return {value!r}\n"
        write_wheel(folder, "ball", f"1.{k}", source)
        releases.append(Release(Version(f"1.{k}"), PYTHON))
    return releases


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """A bisection of a script over releases with given heights."""

    def make_bisection(
        source: str,
        criterion: Criterion | None = None,
        values: Sequence[float | str] = VALUES,
        plan: Plan | None = None,
        reading: Reading | None = None,
        **settings: object,
    ) -> Bisection:
        wheels = tmp_path / "wheels"
        script = tmp_path / "fall.py"
        script.write_text(source)
        releases = write_ball(wheels, values)
        installer = UnzippingInstaller(wheels)
        store = EnvironmentStore(tmp_path / "environments", installer)  # type: ignore[arg-type]
        question = Question("ball", (), replace(Script((str(script),)), **settings), reading or Reading())  # type: ignore[arg-type]
        (tmp_path / "out").mkdir(exist_ok=True)
        trials = Trials(question, store, tmp_path / "out")
        trials.read_kept()
        return Bisection(releases, trials, criterion or Criterion("exit"), plan or Plan(repeats=1))

    return make_bisection


def answered(bisection: Bisection) -> Answer:
    return make_answer(bisection, bisection.find_changes(), "a test", 0.0)


def test_the_first_bad_release_is_found_by_exit_code(make: Make) -> None:
    answer = answered(make(FALL))
    assert answer.words == ["ball: good up to 1.2 (exit code 0), bad from 1.3 on (AssertionError: 2.0)"]
    assert answer.costs.environments <= answer.costs.bound == 3 + 2
    assert answer.changes[0].packages == []
    assert answer.changes[0].defaults is None


def test_good_and_bad_exchanged_are_said_and_searched(make: Make) -> None:
    answer = answered(make(FALL.replace("<", ">")))
    assert answer.words == ["ball: bad up to 1.2 (AssertionError: 1.0), good from 1.3 on (exit code 0)"]
    assert (
        "the older end is bad and the newer one good: what was looked for is the release that mended it" in answer.notes
    )


def test_numbers_are_held_against_the_older_end_and_all_changes_are_found(make: Make) -> None:
    number = Reading(number="height")
    first = answered(make(HEIGHT, Criterion("same"), reading=number))
    assert first.words == ["ball 1.3 is the first release that differs from 1.2: 1 becomes 2"]
    every = answered(make(HEIGHT, Criterion("same"), reading=number, plan=Plan(every=True)))
    assert [(change.before, change.after) for change in every.changes] == [("1.2", "1.3"), ("1.4", "1.5")]
    assert every.costs.environments <= 2 * 3 + 2


def test_bounds_say_what_is_good(make: Make) -> None:
    answer = answered(make(HEIGHT, Criterion("bounds", bounds=(0.0, 2.5)), reading=Reading(number="last")))
    assert answer.words == ["ball: good up to 1.4 (2), bad from 1.5 on (3)"]


def test_a_table_is_held_against_that_of_the_older_end(make: Make) -> None:
    source = "import ball\nrows = [(0.1 * k, 1.0, ball.height() * k) for k in range(5)]\n"
    source += "open('out.csv', 'w').write('time,level,height\\n' + ''.join('%r,%r,%r\\n' % row for row in rows))\n"
    for columns, expected in (((), 1), (("height",), 1), (("time", "level"), 0)):
        criterion = Criterion("same", columns=columns)
        answer = answered(make(source, criterion, reading=Reading(table="out.csv")))
        assert len(answer.changes) == expected
    assert answer.words == [
        "1.0 and 1.7 are alike (0 of the range from 1.0): nothing is looked for between them; --each tries every release"
    ]
    assert not answer.found


def test_every_byte_counts_where_that_is_asked_for(make: Make) -> None:
    answer = answered(
        make("import ball\nprint(ball.height())\n", Criterion("changed"), values=[1.0, 1.0, 1.0000001, 1.0000001])
    )
    assert [(change.before, change.after) for change in answer.changes] == [("1.1", "1.2")]


BROKEN = {
    "raise ImportError('no such module')\n": "cannot run: ImportError: no such module",
    "def weight():\n    return 1.0\n": "cannot run: AttributeError: module 'ball' has no attribute 'height'",
    "import os\nos.abort()\n": "cannot run: ended by signal 6 (SIGABRT)",
    "import sys\nsys.exit(125)\n": "cannot run: exit code 125",
}


def test_releases_that_cannot_run_are_passed_over(make: Make) -> None:
    answer = answered(make(FALL, values=[1.0, 1.0, *BROKEN, 3.0, 3.0]))
    assert answer.words == [
        "ball: good up to 1.1 (exit code 0), bad from 1.6 on (AssertionError: 3.0) (1.2, 1.3, 1.4, 1.5 between them cannot run)"
    ]
    assert answer.costs.environments <= answer.costs.bound == 3 + 2 + len(BROKEN)
    said = [row.value for row in answer.rows if row.label == "cannot run"]
    assert [value.partition(". Did you mean")[0] for value in said] == list(
        BROKEN.values()
    )  # Python 3.13 guesses a name


def test_an_exception_is_bad_where_the_user_says_so(make: Make) -> None:
    values = [1.0, 1.0, "raise ImportError('no such module')", 3.0]
    assert answered(make(FALL, values=values, judges=False)).changes[0].after == "1.2"


def test_what_cannot_run_any_more_is_the_answer(make: Make) -> None:
    answer = answered(make(FALL, values=[1.0, 1.0, 1.0, *["raise ImportError('gone')"] * 3]))
    assert answer.words[0] == "ball: cannot run from 1.3 on (1.2 is the last that runs): ImportError: gone"
    assert answer.found


def test_each_release_can_be_tried(make: Make) -> None:
    gone = "raise ImportError('libgone.so.1: cannot open shared object file')"
    answer = answered(make(FALL, values=[1.0, 3.0, 1.0, gone], plan=Plan(each=True, repeats=1)))
    assert [(change.before, change.after) for change in answer.changes] == [("1.0", "1.1"), ("1.1", "1.2")]
    assert answer.words[0].startswith("ball: cannot run from 1.3 on (1.2 is the last that runs)")
    assert answer.costs.environments == answer.costs.bound == 4
    assert any("an older one by --beside may help" in note for note in answer.notes)


def test_a_range_of_which_neither_end_runs_is_refused(make: Make) -> None:
    with pytest.raises(
        InputError,
        match=r"neither 1\.0 nor 1\.2 can run it: write a range with an end that can \(1\.0: ModuleNotFoundError",
    ):
        make(FALL, values=["import nothing_at_all"] * 3).find_changes()


def test_a_script_without_its_file_says_what_to_write(make: Make) -> None:
    with pytest.raises(InputError, match=r"model\.xml.*files beside the script are copied by --with"):
        make("open('model.xml')").find_changes()


COUNTED = """import os, sys
place = {place!r}
count = len(os.listdir(place))
open(os.path.join(place, str(count)), "w").close()
"""


@pytest.mark.parametrize(
    ("tail", "criterion", "reading", "words"),
    [
        (
            "sys.exit(count % 2)",
            Criterion("exit"),
            Reading(),
            r"1\.0 is good, bad, good in one and the same environment",
        ),
        (
            "print('height', 1 + 0.1 * count)",
            Criterion("same"),
            Reading("height"),
            r"1\.0 scatters by 0\.2 of its size .*\(1, 1\.1, 1\.2\)",
        ),
        ("print(count)", Criterion("changed"), Reading(), r"1\.0 prints or writes something else each time"),
        (
            "sys.exit(125 * (count % 2))",
            Criterion("exit"),
            Reading(),
            r"1\.0 ran, and did not run, in one and the same environment",
        ),
    ],
)
def test_a_script_that_is_not_repeatable_is_refused_with_its_scatter(
    make: Make, tmp_path: Path, tail: str, criterion: Criterion, reading: Reading, words: str
) -> None:
    (place := tmp_path / "counts").mkdir()
    with pytest.raises(NotRepeatable, match=f"{words}.*fix its seed"):
        make(COUNTED.format(place=str(place)) + tail, criterion, reading=reading, plan=Plan()).find_changes()


def test_a_tolerance_above_the_scatter_lets_a_larger_change_be_found(make: Make, tmp_path: Path) -> None:
    (place := tmp_path / "counts").mkdir()
    source = COUNTED.format(place=str(place)) + "import ball\nprint('height', ball.height() + 0.001 * (count % 2))"
    assert (
        answered(make(source, Criterion("same", tolerance=0.01), reading=Reading("height"), plan=Plan()))
        .changes[0]
        .after
        == "1.3"
    )


def test_a_script_that_flips_only_where_it_matters_is_refused_too(make: Make, tmp_path: Path) -> None:
    """Both ends are steady; the release after the change is not, and is run again before it is blamed."""
    (place := tmp_path / "counts").mkdir()
    flaky = f"import os\ncount = len(os.listdir({str(place)!r}))\nopen(os.path.join({str(place)!r}, str(count)), 'w').close()\n"
    flaky += "def height():\n    return 1.0 if count % 2 else 9.0\n"
    with pytest.raises(NotRepeatable, match=r"1\.2 is bad, good, bad in one and the same environment"):
        make(FALL, values=[1.0, 1.0, flaky, 9.0, 9.0], plan=Plan()).find_changes()


def test_a_hang_a_flood_and_children_that_stay_are_ended(make: Make, tmp_path: Path) -> None:
    child = tmp_path / "child"
    hangs = "import subprocess, sys, time\nchild = subprocess.Popen(['sleep', '600'], start_new_session=True)\n"
    hangs += f"open({str(child)!r}, 'w').write(str(child.pid))\ntime.sleep(600)\n"
    floods = f"import os\nwhile True:\n    os.write(1, b'x' * {FLOOD // 4})\n"
    answer = answered(make(FALL, values=[1.0, hangs, floods, 3.0], timeout=0.5))
    values = {row.release: row.value for row in answer.rows}
    assert values["1.1"] == "cannot run: it hangs: stopped after the time limit of 0.5 s"
    assert values["1.2"] == "cannot run: it floods: stopped after it had printed 16 MB"
    assert not is_alive(int(child.read_text()))


def is_alive(process: int) -> bool:
    """Whether a process runs; one that has ended may be listed until somebody asks for its end."""
    status = Path("/proc", str(process), "stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] not in "ZX"


def test_a_script_that_changes_its_folder_meets_it_unchanged_each_time(make: Make, tmp_path: Path) -> None:
    source = "import os\nassert os.listdir() == ['fall.py'], os.listdir()\n"
    source += "open('left', 'w').close()\nopen('fall.py', 'w').close()\n"
    answer = answered(make(source, plan=Plan()))
    assert answer.words[0].startswith("1.0 and 1.7 are both good")
    assert (tmp_path / "fall.py").read_text() == source


def test_scripts_get_no_tokens_of_the_caller(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_TOKEN", "secret")
    monkeypatch.setenv("PIP_INDEX_URL", "https://me:secret@example.org")
    source = "import os\nassert 'secret' not in repr(dict(os.environ)), 1\n"
    assert answered(make(source)).words[0].startswith("1.0 and 1.7 are both good")
    assert answered(make(source, passed=("MY_TOKEN",))).words[0].startswith("1.0 and 1.7 are both bad")


def test_a_second_run_goes_on_where_the_first_was_stopped(make: Make, tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    first = make(FALL)

    def stop(release: str, words: str) -> None:
        if words == "environment" and len(asked(first)) == 3:
            raise Stopped

    first.trials.notify = stop
    with pytest.raises(Stopped):
        first.find_changes()
    second = make(FALL)
    assert second.trials.taken == 3
    assert answered(second).changes[0].after == "1.3"
    assert not set(asked(first)) & set(asked(second))
    third = make(FALL)
    assert answered(third).costs.made == 0
    assert asked(third) == []


def test_a_question_is_the_same_wherever_its_script_lies(tmp_path: Path) -> None:
    digests = set()
    for place, source in (("a", "x"), ("b", "x"), ("c", "y")):
        (tmp_path / place).mkdir()
        (tmp_path / place / "run.py").write_text(source)
        digests.add(Script((str(tmp_path / place / "run.py"), "--fast")).compute_digest())
    assert len(digests) == 2


def asked(bisection: Bisection) -> list[str]:
    installer = bisection.trials.store.installer
    assert isinstance(installer, UnzippingInstaller)
    return installer.asked


def test_what_was_kept_of_another_script_or_is_damaged_is_left(make: Make, tmp_path: Path) -> None:
    answered(make(FALL))
    assert make(FALL + "\n").trials.taken == 0
    state = tmp_path / "out" / STATE
    for text in ("", "[]", "{", json.dumps({"question": make(FALL).trials.question.compute_digest(), "trials": 3})):
        state.write_text(text)
        assert make(FALL).trials.taken == 0


def test_a_release_that_cannot_be_had_is_passed_over_and_trouble_of_the_network_is_not(make: Make) -> None:
    bisection = make(FALL, values=[1.0, 1.0, 1.0, 3.0, 3.0])
    installer = bisection.trials.store.installer
    assert isinstance(installer, UnzippingInstaller)
    installer.refused = {"ball==1.2": "no wheel of it fits"}
    assert answered(bisection).changes[0].holes == ("1.2",)

    def fail(*words: object) -> str:
        raise InstallerError("the index cannot be reached")

    other = make(FALL + "#\n", values=[1.0, 1.0, 3.0])
    other.trials.store.installer.resolve_pins = fail  # type: ignore[method-assign]
    other.trials.store.folder = other.trials.store.folder / "new"
    with pytest.raises(InstallerError, match="cannot be reached"):
        other.find_changes()
    assert "1.0" not in json.dumps(sorted(os.listdir(other.trials.folder)))


def test_releases_without_a_wheel_cost_no_environment(make: Make) -> None:
    bisection = make(FALL)
    bisection.releases = [replace(r, python=None) if str(r) in ("1.2", "1.3") else r for r in bisection.releases]
    answer = answered(bisection)
    assert answer.changes[0].holes == ("1.2", "1.3")
    assert answer.costs.environments <= 3 + 2


DEPENDS = "import air\ndef height():\n    return {height} + air.LIFT\n"


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        ((1.0, 1.0), "gives the old result (exit code 0): it is not ball, it is air"),
        ((1.0, 5.0), "gives the new result, too (AssertionError: 5.0): it is ball itself"),
    ],
)
def test_a_dependency_that_changed_is_told_from_the_package(
    make: Make, tmp_path: Path, heights: tuple[float, float], words: str
) -> None:
    bisection = make(FALL, values=[1.0, 1.0])
    wheels = tmp_path / "wheels"
    write_wheel(wheels, "air", "1", "LIFT = 0.0\n")
    write_wheel(wheels, "air", "2", "LIFT = 3.0\n")
    write_wheel(wheels, "ball", "1.0", DEPENDS.format(height=heights[0]), ["air==1"])
    write_wheel(wheels, "ball", "1.1", DEPENDS.format(height=heights[1]), ["air"])
    change = answered(bisection).changes[0]
    assert change.packages == [("air", "1", "2")]
    assert change.origin == f"1.1 beside the old air {words}"
