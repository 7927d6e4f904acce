"""The cases beside a model, and which of them a command is about."""

from __future__ import annotations

from pathlib import Path

from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism
from flexinv.validation import find_nearest_word


def resolve_model_folder(model: Path) -> Path:
    """Return the folder of a model that is given as a folder or as its mechanism.toml."""
    return model.parent if model.suffix else model


def choose(cases: dict[str, Case], name: str | None, model: Path) -> Case:
    """Return the case of that name, or the only one there is; InputError lists the names."""
    if name is None and len(cases) == 1:
        return next(iter(cases.values()))
    if name is None:
        raise InputError(f"{model} has {len(cases)} cases: write --case with one of {', '.join(cases)}")
    if name not in cases:
        like = find_nearest_word(name, cases)
        advice = f"write --case {like}" if like else f"write one of {', '.join(cases)}"
        raise InputError(f"--case {name}: {model} has no such case; {advice}")
    return cases[name]


def read_own_cases(model: Path, mechanism: Mechanism) -> dict[str, Case]:
    """Return the cases [-] that stand beside a mechanism, none where there is no file of them."""
    folder = resolve_model_folder(model)
    return load_cases(folder, mechanism) if (folder / "cases.toml").is_file() else {}
