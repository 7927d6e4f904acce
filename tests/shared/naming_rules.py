"""House rules of names and sizes: source text in, broken rules out.  `test_style.py` runs them, and breaks each of them."""

from __future__ import annotations

import ast
import re
from collections.abc import Container, Iterable, Mapping

from house_rules import parsed, walked

MODULES = 20  # of a folder: what a reader takes in at once
PARAMETERS = 8
LINES = 400  # of a module, as in `house_rules`
# What arrays, numbers and strings have: `a.shape` does not make a record of a.
_PLAIN = {
    "T", "shape", "size", "ndim", "dtype", "flags", "copy", "sum", "min", "max", "mean", "any", "all", "ravel", "reshape", "real",
    "imag", "conj", "tolist", "astype", "fill", "dot", "item", "nbytes", "argmax", "argmin", "std", "is_integer", "join", "split",
    "strip", "startswith", "endswith", "replace", "lower", "upper", "format", "removeprefix", "removesuffix", "partition",
    "rpartition", "items", "keys", "values", "get", "append", "update", "index", "count", "name",
}  # fmt: skip
_QUESTION = re.compile(r"(return )?(what|where|whether|how|which|when|why)\b", re.IGNORECASE)


def crowded(folders: Mapping[str, int]) -> list[str]:
    """Folders of a package with more modules than a reader takes in at once (folder -> modules)."""
    return [f"{folder}: {n} modules, at most {MODULES}" for folder, n in folders.items() if n > MODULES]


def read_verbs(page: str) -> frozenset[str]:
    """Return the verbs of the contributing page: the words between ``verbs:`` and the full stop behind them."""
    listed = page.split("\nverbs:", 1)[1].split(".", 1)[0]
    return frozenset(word.strip() for word in listed.split(","))


def without_verb(source: str, verbs: Container[str], kept: Container[str]) -> list[str]:
    """Functions, properties apart, whose names begin with no verb of the list and are not among those that are kept."""
    broken = []
    for function in _functions(source):
        decorators = " ".join(ast.unparse(one) for one in function.decorator_list)
        is_noun = "property" in decorators or ".setter" in decorators or function.name.startswith("__")
        first = function.name.strip("_").split("_")[0]
        if not is_noun and first not in verbs and function.name not in kept:
            broken.append(f"line {function.lineno}: {function.name} begins with no verb of CONTRIBUTING.md")
    return broken


def function_names(source: str) -> set[str]:
    """Names of all functions and methods."""
    return {function.name for function in _functions(source)}


def many_parameters(source: str) -> list[str]:
    """Functions with more than eight parameters.

    Keywords with defaults of public functions do not count (a caller names those that it wants), nor options of commands.
    """
    broken = []
    for function in _functions(source):
        a = function.args
        names = [x.arg for x in (*a.posonlyargs, *a.args) if x.arg not in ("self", "cls")]
        optional = 0 if function.name.startswith("_") else len(a.defaults)
        if function.name.startswith("_"):
            names += [x.arg for x in a.kwonlyargs]
        if len(names) - optional > PARAMETERS and not _is_command(function):
            broken.append(f"line {function.lineno}: {function.name} has {len(names) - optional} parameters")
    return broken


def letter_records(source: str) -> list[str]:
    """Records that are handed over under one letter: parameters of one letter of which an attribute is read."""
    broken = []
    for function in _functions(source):
        letters = {x.arg for x in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)}
        used = {
            node.value.id: node.attr
            for node in ast.walk(function)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr not in _PLAIN
        }
        broken += [
            f"line {function.lineno}: {function.name} calls a record {letter} ({letter}.{used[letter]})"
            for letter in sorted(letters & used.keys())
            if len(letter) == 1
        ]
    return broken


def questions(source: str) -> list[str]:
    """Docstrings that begin as an indirect question; a function's begins with a verb."""
    nodes = [
        parsed(source),
        *(n for n in walked(source) if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))),
    ]
    return [
        f"line {getattr(node, 'lineno', 1)}: {(ast.get_docstring(node) or '').splitlines()[0]!r} asks"
        for node in nodes
        if _QUESTION.match(ast.get_docstring(node) or "")
    ]


def homeless(homes: Mapping[str, str], known: Iterable[str] = ()) -> list[str]:
    """Public functions that do not live in a module of their own name (name -> dotted module)."""
    return [
        f"{name} lives in {module}"
        for name, module in homes.items()
        if name[0].islower() and module.rpartition(".")[2] != name and name not in known
    ]


def homonyms(
    sources: Mapping[str, str],
    twins: Iterable[tuple[str, str]] = (),
    known: Container[str] = (),
    private: Container[str] = (),
) -> list[str]:
    """Names that two modules define (dotted module -> source): each has one meaning; with _ only those of ``private``.

    twins : pairs of packages, or modules, that do the same in two forms, where the same name says so
    known : names that mean the same wherever they are defined; commands are called as their verbs
    """
    places: dict[str, list[str]] = {}
    second = {two: one for one, two in twins}
    for module, source in sources.items():
        package = module.rpartition(".")[0]
        form = second.get(module, second.get(package, package if package in second.values() else module))
        for name in _defined(source):
            open_ = not name.startswith("_") or name in private
            if open_ and name not in known and form not in places.setdefault(name, []):
                places[name].append(form)
    return [f"{word} is defined in {', '.join(result)}" for word, result in sorted(places.items()) if len(result) > 1]


def lonely(sources: Mapping[str, str], imports: Mapping[str, Iterable[str]], known: Mapping[str, str]) -> list[str]:
    """Modules that one other imports, of the same folder, and that fit into it: a reason to merge them.

    sources, imports : dotted module -> source, -> importers; those that a package offers itself (``__init__``) are its own
    known : modules that stay apart -> the reason; one that is not alone any more, or has no reason, is told, too
    """
    size = {module: len(source.splitlines()) for module, source in sources.items()}
    result = {
        module: importers[0]
        for module, importers in ((m, sorted(set(imports.get(m, ())))) for m in sources)
        if len(importers) == 1
        and importers[0].rpartition(".")[0] == module.rpartition(".")[0]
        and size[module] + size[importers[0]] <= LINES
    }
    broken = [
        f"{module} is imported by {one} alone: merge them" for module, one in result.items() if not known.get(module)
    ]
    return broken + [f"{module} needs no reason to stay apart" for module in known if module not in result]


def _defined(source: str) -> set[str]:
    """Functions, classes and constants of a module."""
    names = set()
    for node in parsed(source).body:
        if isinstance(node, ast.ClassDef) or (isinstance(node, ast.FunctionDef) and not _is_command(node)):
            names.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {x.id for target in targets for x in ast.walk(target) if isinstance(x, ast.Name)}
    return names


def _functions(source: str) -> list[ast.FunctionDef]:
    return [node for node in walked(source) if isinstance(node, ast.FunctionDef)]


def _is_command(function: ast.FunctionDef) -> bool:
    return any(re.search(r"\.(command|callback|group)\b|^click\.", ast.unparse(d)) for d in function.decorator_list)
