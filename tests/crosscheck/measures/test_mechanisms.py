"""Mechanisms as engines get them: with the retardation time that a stated damping ratio makes of their beams."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from crosscheck.engines import ENGINES, adapter
from crosscheck.measures.mechanisms import check_resolved, read_mechanism
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism

RATIO = "\n[damping]\nratio = 0.02\n"


@pytest.mark.parametrize("engine", ["exudyn-ge", "exudyn-ancf", "mujoco-flex"])
def test_no_engine_leaves_a_stated_ratio_out_without_a_word(engine: str, root: Path, tmp_path: Path) -> None:
    folder = tmp_path / "flex_one_link"
    shutil.copytree(root / "models" / "flex_one_link", folder)
    text = (folder / "mechanism.toml").read_text()
    (folder / "mechanism.toml").write_text(text + RATIO)
    mechanism = load_mechanism(folder)
    case = next(iter(load_cases(folder, mechanism).values()))
    with pytest.raises(InputError, match=r"stated as a ratio .*read_mechanism\(folder\)"):
        adapter(ENGINES[engine]).run(mechanism, case, engine, {})
    resolved = read_mechanism(folder)
    check_resolved(resolved)
    assert resolved.links[0].beam is not None
    assert resolved.links[0].beam.section.damping.any()
