"""Measures of the house: how dense the code of a package is, and how its functions are called.

    python tests/shared/house_table.py flexinv crosscheck

Tokens are names, operators, numbers and strings outside of docstrings.  A simple statement is an assignment, a call, a return
and the like; a docstring is none.  A tuple assignment packs: as many targets as values in one statement.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

MOST_TOKENS = 450  # of a function
MOST_BRANCHES = 12  # of a function, conditional expressions, comprehensions, `and` and `or` among them
COUNTED = (tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING)
SIMPLE = (
    ast.Assign,
    ast.AnnAssign,
    ast.AugAssign,
    ast.Return,
    ast.Expr,
    ast.Raise,
    ast.Assert,
    ast.Delete,
    ast.Import,
    ast.ImportFrom,
)
BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension, ast.match_case)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
# Participles that do not end in -ed.
IRREGULAR = """
begun bent bound broken brought built chosen done drawn driven fallen fed felt forgotten found given gone
got grown heard held hidden kept known laid led left lent lost made meant met own paid risen said
seen sent shown sold spent spoken stood struck sung swept sworn taken thought thrown told torn
understood woken won worn wound written
"""


@dataclass(frozen=True)
class Function:
    """One function: its place, and what is counted in it."""

    name: str
    place: str
    lines: int
    tokens: int
    branches: int
    is_property: bool


@dataclass(frozen=True)
class Module:
    """One module: lines, lines with code, tokens of it and of each simple statement, assignments, functions."""

    lines: int
    code_lines: int
    tokens: int
    statements: tuple[int, ...]
    assignments: int
    packed: int
    functions: tuple[Function, ...]


def measure(path: Path, text: str) -> Module:
    """Return the measures of a module."""
    tree = ast.parse(text)
    hidden = set(_docstring_lines(tree))
    starts = [t.start for t in _tokens(text) if t.start[0] not in hidden]
    simple = [node for node in ast.walk(tree) if isinstance(node, SIMPLE) and node.lineno not in hidden]
    assigned = [node for node in simple if isinstance(node, ast.Assign)]
    functions = tuple(_functions(path, tree, starts))
    statements = tuple(_count(starts, node) for node in simple)
    packed = sum(map(is_packed, assigned))
    rows = {row for row, _ in starts}
    return Module(text.count("\n"), len(rows), len(starts), statements, len(assigned), packed, functions)


def is_packed(node: ast.Assign) -> bool:
    """Return True if an assignment has several targets and as many values, and is no swap."""
    if not (isinstance(node.value, ast.Tuple) and any(isinstance(t, ast.Tuple) for t in node.targets)):
        return False
    return sorted(ast.dump(v) for v in _loaded(node.targets[0])) != sorted(ast.dump(v) for v in node.value.elts)


def _loaded(target: ast.expr) -> list[ast.expr]:
    """Return the parts of a target as they are read."""
    parts = ast.parse(ast.unparse(target), mode="eval").body
    return list(parts.elts) if isinstance(parts, ast.Tuple) else [parts]


def _tokens(text: str) -> Iterator[tokenize.TokenInfo]:
    """Yield what is counted; a formatted string is one token, whatever Python 3.12 and later find in it."""
    depth = 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        kind = tokenize.tok_name[token.type]
        depth -= kind == "FSTRING_END"
        if not depth and (token.type in COUNTED or kind == "FSTRING_START"):
            yield token
        depth += kind == "FSTRING_START"


def _docstring_lines(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and node.body and ast.get_docstring(node, clean=False) is not None:
            first = node.body[0]
            yield from range(first.lineno, (first.end_lineno or first.lineno) + 1)


def _count(starts: list[tuple[int, int]], node: ast.stmt) -> int:
    """Return the number of tokens of a statement."""
    end = (node.end_lineno or node.lineno, node.end_col_offset or 0)
    return bisect_left(starts, end) - bisect_left(starts, (node.lineno, node.col_offset))


def _functions(path: Path, tree: ast.Module, starts: list[tuple[int, int]]) -> Iterator[Function]:
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        branches = _count_branches(node)
        names = {getattr(d, "id", getattr(d, "attr", "")) for d in node.decorator_list}
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
        place = f"{path}:{node.lineno}"
        is_property = bool(names & {"property", "cached_property"})
        yield Function(node.name, place, lines, _count(starts, node), branches, is_property)


def _count_branches(node: ast.AST) -> int:
    parts = list(ast.walk(node))
    joined = sum(len(part.values) - 1 for part in parts if isinstance(part, ast.BoolOp))
    return joined + sum(isinstance(part, BRANCHES) for part in parts)


def is_bare_participle(name: str) -> bool:
    """Return True if a name begins with a participle, as ``told`` and ``kept_rows`` do.

    ``read``, ``run``, ``put``, ``cut``, ``set``, ``shut`` and ``split`` are verbs, too.
    """
    first = name.strip("_").split("_")[0]
    return first in IRREGULAR.split() or (
        first.endswith("ed") and len(first) > 3 and first not in ("need", "feed", "seed", "speed")
    )


def list_modules(package: Path) -> list[Module]:
    """Return the measures of all modules of a package."""
    files = sorted(path for path in package.rglob("*.py") if "__pycache__" not in path.parts)
    return [measure(path, path.read_text(encoding="utf-8")) for path in files]


def describe(name: str, modules: list[Module]) -> str:
    """Return the line of a package in the table."""
    functions = [f for module in modules for f in module.functions]
    statements = [n for module in modules for n in module.statements]
    tokens, lines = sum(m.tokens for m in modules), sum(m.code_lines for m in modules)
    assignments = sum(m.assignments for m in modules)
    named = [f for f in functions if not f.is_property and not f.name.startswith("__")]
    bare = [f for f in named if is_bare_participle(f.name)]
    cells = (
        name,
        f"{len(modules)} / {sum(m.lines for m in modules)}",
        f"{median(m.lines for m in modules):.0f} / {max(m.lines for m in modules)}",
        _spread(f.lines for f in functions),
        str(tokens),
        f"{tokens / lines:.1f}",
        _spread(statements, 50, 90, 99),
        _spread(f.tokens for f in functions),
        str(sum(f.tokens > MOST_TOKENS for f in functions)),
        str(sum(f.branches > MOST_BRANCHES for f in functions)),
        f"{sum(m.packed for m in modules)} ({100 * sum(m.packed for m in modules) / assignments:.1f} %)",
        f"{len(bare)} ({100 * len(bare) / len(named):.1f} %)",
    )
    return "| " + " | ".join(cells) + " |"


def _spread(values: Iterable[int], *parts: int) -> str:
    numbers = np.array(list(values))
    marks = np.percentile(numbers, parts or (50, 90, 100))
    return " / ".join(f"{mark:.0f}" for mark in marks)


HEAD = (
    "package",
    "modules / lines",
    "lines of a module: median / most",
    "lines of a function: median / p90 / most",
    "tokens",
    "tokens a code line",
    "tokens a simple statement: median / p90 / p99",
    "tokens of a function: median / p90 / most",
    f"functions of more than {MOST_TOKENS} tokens",
    f"functions of more than {MOST_BRANCHES} branches",
    "tuple assignments",
    "functions named by a participle",
)


def main(packages: Iterable[str]) -> None:
    """Print the table of packages."""
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    lines += [describe(package, list_modules(Path(package))) for package in packages]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:] or ("flexinv", "crosscheck"))
