"""A share of the campaign of exported libraries: calls by lot find a planted fault, steps take no memory, motions fit."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from c_library import needs_compiler

from campaigns.hardness.fuzz_calls import list_prototypes
from campaigns.hardness.libraries import RIGID_ARM, list_bangs, list_waves, open_library, run_command
from campaigns.hardness.shows import compile_fuzz
from flexinv.errors import FlexinvError
from flexinv.export.machine_code import NATIVE

CALLS = 3000


@needs_compiler
@pytest.mark.skipif(shutil.which("gcc") is None, reason="the sanitizers are those of gcc")
def test_calls_by_lot_find_an_index_that_is_not_checked() -> None:
    """The library as it is written answers all of them; one that writes where an index says does not."""
    with open_library(RIGID_ARM) as library:
        answered = run_command([compile_fuzz(library, NATIVE), library.motion, CALLS, 1])
        functions = {one.name for one in list_prototypes(library) if one.returned == "int"}
        assert {line.split()[0] for line in answered.splitlines()} == functions
        source = library.folder / "src" / f"{library.name}.c"
        text = source.read_text(encoding="utf-8")
        check = f"rate >= {library.name.upper()}_NV || "
        assert text.count(check) == 1
        source.write_text(text.replace(check, ""), encoding="utf-8")
        with pytest.raises(FlexinvError, match=r"ended with"):
            run_command([compile_fuzz(library, NATIVE), library.motion, CALLS, 1])


@needs_compiler
def test_steps_make_no_system_call_and_take_no_memory() -> None:
    """Under seccomp's strict mode, which ends the program at the first one."""
    with open_library(RIGID_ARM) as library:
        program = library.compile("steps.c", words=("-DCOUNT_MALLOC",))
        said = run_command([program, library.motion, 1000, 1])
        assert said.strip() == "steps 1000 allocations 0 refused 0"


@pytest.mark.parametrize("path", [list_bangs, list_waves])
def test_rates_are_those_of_the_path(path: object) -> None:
    """Central differences of places, whose error is 2e-4 of the largest rate, beside rates, where accelerations do not jump."""
    assert callable(path)
    step, count = 1e-3, 400
    s, v, a = np.array(path(count, step)).T
    smooth = np.abs(np.diff(a)).max() < 50.0
    inside = np.ones(count - 2, dtype=bool) if smooth else np.abs(np.diff(a[:-1])) + np.abs(np.diff(a[1:])) < 1e-9
    assert np.abs((s[2:] - s[:-2]) / (2 * step) - v[1:-1])[inside].max() < 1e-3 * np.abs(v).max()
    assert max(abs(s[-1]), abs(v[-1])) < 1e-12
    assert s.max() == pytest.approx(1.0)
