"""FMUs of rigid trees, by the generator of plugins/crosscheck-fmu-example."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

from crosscheck.kit.write import write
from crosscheck.verdicts.plan import discover

ROOT = Path(__file__).resolve().parents[2]
GENERATOR = ROOT / "plugins" / "crosscheck-fmu-example" / "make_fmu.py"


def generator() -> Any:
    """The module ``make_fmu``."""
    spec = importlib.util.spec_from_file_location("make_fmu", GENERATOR)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where its dataclasses look for the names of their annotations
    spec.loader.exec_module(module)
    return module


def build(folder: Path, case: str, file: str = "plant.fmu", **words: Any) -> Path:
    """An FMU in a folder, of a case of the models; words : of `make_fmu.make`."""
    task = discover(ROOT / "models", [case]).tasks[0]
    kit = folder / f"kit of {file}"
    write(task.mechanism, task.case, kit)
    made: Path = generator().make(kit, folder / file, **words)
    return made
