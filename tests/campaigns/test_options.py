"""Scripts outside the packages read those options that they declare: a name that is changed on one side alone is found."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

FOLDERS = ("campaigns", "benchmarks", "plugins", "tests/shared")


def list_unknown_options(source: str) -> list[str]:
    """Options that a script reads of what `parse_args` returns, and that it declares nowhere."""
    tree = ast.parse(source)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)]
    declared = {_find_destination(call) for call in calls if call.func.attr == "add_argument"}  # type: ignore[attr-defined]
    parsed = {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and ast.unparse(node.value).endswith(".parse_args()")
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    read = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in parsed
    }
    return sorted(read - declared)


def _find_destination(call: ast.Call) -> str:
    """The attribute under which an option stands: that of dest, of its long name, or of its only one."""
    named = [word.value.value for word in call.keywords if word.arg == "dest" and isinstance(word.value, ast.Constant)]
    names = [part.value for part in call.args if isinstance(part, ast.Constant)]
    longest = next((name for name in names if str(name).startswith("--")), names[0] if names else "")
    return str(named[0] if named else longest).lstrip("-").replace("-", "_")


def list_scripts(root: Path) -> list[Path]:
    """Scripts with options of their own."""
    files = (file for folder in FOLDERS for file in sorted((root / folder).rglob("*.py")))
    return [file for file in files if ".parse_args()" in file.read_text()]


def test_scripts_read_the_options_that_they_declare(root: Path) -> None:
    scripts = list_scripts(root)
    assert len(scripts) >= 10
    wrong = {
        str(file.relative_to(root)): unknown for file in scripts if (unknown := list_unknown_options(file.read_text()))
    }
    assert wrong == {}


@pytest.mark.parametrize(("read", "unknown"), [("keep", []), ("add_answer", ["add_answer"])])
def test_an_option_that_is_declared_under_another_name_is_found(read: str, unknown: list[str]) -> None:
    source = 'parser.add_argument("--keep")\nparser.add_argument("folders", nargs="*")\ngiven = parser.parse_args()\n'
    assert list_unknown_options(f"{source}print(given.folders, given.{read})\n") == unknown
