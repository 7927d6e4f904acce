"""The house rules as functions: source text in, broken rules out (one string each, "line N: ...").

`test_style.py` runs them over the project and shows each of them a small text that it must refuse.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Container, Iterator, Mapping
from functools import cache
from pathlib import Path

from house_table import MOST_BRANCHES, MOST_TOKENS, measure

MODULE_LINES = 500
FUNCTION_LINES = 80  # of code, without the docstring: what a numerical kernel may take
_SYMBOL = r"(?:1|m|kg|s|rad|deg|N|J|W|Hz|Pa|%)(?:\^-?\d)?"
_PRODUCT = rf"(?:-|{_SYMBOL}(?:[ /]{_SYMBOL})*)"
UNIT = re.compile(rf"\[(?:any unit|unit(?: of [\w\s]+)?|{_PRODUCT}(?:(?:, | or ){_PRODUCT})*)\]")
ENGINES = ("pinocchio", "mujoco", "exudyn")
TYPES = ("Array", "Complex", "Indices", "Mask", "Sparse", "Triple")
GRAPHICS = ("matplotlib", "plotly", "PIL")
# Primary data and the reading of it; everything else of flexinv computes and would agree with itself.
PRIMARY = ("errors", "typing", "model", "files")
Function = ast.FunctionDef | ast.AsyncFunctionDef
OPEN = "dict[str, Any]"  # says nothing of what is in it
OPEN_DICTS = 100  # in a package: options as users write them, JSON of others
_WORD = re.compile(r"\w+|[^\w\s]")  # a token is one of these, or several
_FORK = re.compile(r"\b(?:if|elif|for|while|except|case|and|or)\b")  # what a branch is written with
_BLOCKS = (ast.Module, ast.stmt, ast.ExceptHandler, ast.match_case)  # what statements stand in


@cache
def parsed(source: str) -> ast.Module:
    """Parse a text once for all rules; no rule changes the tree.  `forget` gives the memory back."""
    return ast.parse(source)


@cache
def walked(source: str) -> tuple[ast.AST, ...]:
    """Give all nodes of a text, as `ast.walk` does, found once for all rules."""
    return tuple(ast.walk(parsed(source)))


def forget() -> None:
    """Let go of all trees: those of the whole project take 250 MB."""
    parsed.cache_clear()
    walked.cache_clear()


def units_in_docstrings(source: str) -> list[str]:
    """Public functions explain themselves; where numbers go in or out they give a unit in brackets."""
    broken = []
    for owner, function in _public_functions(parsed(source)):
        text, name = ast.get_docstring(function), f"{owner}{function.name}"
        if text is None:
            broken.append(f"line {function.lineno}: {name} has no docstring")
        elif _has_numbers(function) and not UNIT.search(text) and not _is_command(function):
            broken.append(f"line {function.lineno}: {name} gives no unit such as [N m] or [-]")
    return broken


def unannotated(source: str) -> list[str]:
    """Every function is annotated completely, unless numba compiles it."""
    broken = []
    for function in _functions(walked(source)):
        if any("jit" in ast.unparse(d) or "vectorize" in ast.unparse(d) for d in function.decorator_list):
            continue
        a = function.args
        bare = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x and not x.annotation]
        bare = [name for name in bare if name not in ("self", "cls")]
        if bare or function.returns is None:
            missing = ", ".join([*bare, *(["return"] if function.returns is None else [])])
            broken.append(f"line {function.lineno}: {function.name} has no annotation of {missing}")
    return broken


def sizes(source: str) -> list[str]:
    """Modules and functions stay short."""
    lines = len(source.splitlines())
    broken = [f"line {MODULE_LINES + 1}: {lines} lines, at most {MODULE_LINES}"] if lines > MODULE_LINES else []
    for function in _functions(walked(source)):
        start = function.body[1 if ast.get_docstring(function) and len(function.body) > 1 else 0].lineno
        length = (function.end_lineno or start) - start + 1
        if length > FUNCTION_LINES:
            broken.append(f"line {function.lineno}: {function.name} has {length} lines, at most {FUNCTION_LINES}")
    return broken


def oversized(source: str, kept: Container[str] = ()) -> list[str]:
    """Functions say few things, counted in tokens and branches; one that is kept (`kept_sizes`) has to be larger still."""
    lines = source.splitlines()
    if not any(f.name in kept or _may_be_oversized(lines, f) for f in _functions(walked(source))):
        return []
    broken = []
    for function in measure(Path(), source).functions:
        line = f"line {function.place.rpartition(':')[2]}: {function.name}"
        over = function.tokens > MOST_TOKENS or function.branches > MOST_BRANCHES
        if over and function.name not in kept:
            counted = f"{function.tokens} tokens and {function.branches} branches"
            broken.append(f"{line} has {counted}, at most {MOST_TOKENS} and {MOST_BRANCHES}")
        if not over and function.name in kept:
            broken.append(f"{line} is small enough: take it off the list of kept sizes")
    return broken


def _may_be_oversized(lines: list[str], function: Function) -> bool:
    """Return False for a function that has no more words and signs than tokens are allowed: counting these takes longer."""
    start = function.body[1 if ast.get_docstring(function) and len(function.body) > 1 else 0].lineno
    text = "\n".join(
        [*lines[function.lineno - 1 : function.body[0].lineno - 1], *lines[start - 1 : function.end_lineno]]
    )
    return len(_WORD.findall(text)) > MOST_TOKENS or len(_FORK.findall(text)) > MOST_BRANCHES


def packed(source: str) -> list[str]:
    """One thought, one statement: values stand in one assignment only where one of them reads what another replaces."""
    return [
        f"line {node.lineno}: {ast.unparse(node.targets[0])} in one assignment; write as many"
        for node in walked(source)
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and _is_packed(node.targets[0], node.value)
    ]


def _is_packed(target: ast.expr, value: ast.expr) -> bool:
    """Return True for targets and values side by side that could stand one after the other."""
    if not (isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts)):
        return False
    if any(isinstance(part, ast.Starred) for part in (*target.elts, *value.elts)):
        return False
    replaced: set[str] = set()
    for one, new in zip(target.elts, value.elts, strict=True):
        if replaced & {part.id for part in ast.walk(new) if isinstance(part, ast.Name)}:
            return False
        replaced |= {part.id for part in ast.walk(one) if isinstance(part, ast.Name)}
    return True


def layering(module: str, source: str) -> list[str]:
    """Imports point down: flexinv knows no crosscheck, an engine only itself and primary data, numerics no graphics."""
    broken = []
    for line, name, inside_function in imports(source):
        reason = _misplaced(module, name, inside_function)
        if reason:
            broken.append(f"line {line}: {module} imports {name}: {reason}")
    return broken


def cycles(modules: dict[str, str]) -> list[str]:
    """No module reaches itself through imports at module level (module name -> source)."""
    known = {
        module: {_module_of(name, modules) for _, name, inside in imports(source) if not inside} - {None, module}
        for module, source in modules.items()
        if not module.endswith("__init__")
    }
    broken = []
    for module in known:
        seen: set[str | None] = set()
        ahead = list(known[module])
        while ahead:
            here = ahead.pop()
            if here not in seen:
                seen.add(here)
                ahead.extend(known.get(str(here), set()))
        if module in seen:
            broken.append(
                f"line 1: {module} imports itself through {', '.join(sorted(map(str, known[module] & seen)))}"
            )
    return broken


def prints(source: str) -> list[str]:
    """Nothing but a command line writes to the terminal."""
    return [
        f"line {node.lineno}: {ast.unparse(node.func)} outside a command line"
        for node in walked(source)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) in ("print", "sys.stdout.write", "sys.stderr.write", "pprint", "pprint.pprint")
    ]


def padded_tolerances(source: str) -> list[str]:
    """A tolerance is not multiplied until the test passes."""
    broken = []
    for node in walked(source):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            sides = (node.left, node.right)
            factors = [s.value for s in sides if isinstance(s, ast.Constant) and isinstance(s.value, (int, float))]
            names = [ast.unparse(s) for s in sides if isinstance(s, (ast.Name, ast.Attribute))]
            if any(f > 1 for f in factors) and any(
                re.search(r"tol(erance|s)?$|^[ar]?tol|limit$", n, re.I) for n in names
            ):
                broken.append(f"line {node.lineno}: padded tolerance {ast.unparse(node)}")
    return broken


def forgotten_raise(source: str) -> list[str]:
    """An exception that is built is raised."""
    return [
        f"line {node.lineno}: {ast.unparse(node.value.func)} is built but not raised"
        for node in walked(source)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Call)
        and ast.unparse(node.value.func).endswith(("Error", "Exception"))
    ]


def second_types(module: str, source: str) -> list[str]:
    """Types of arrays are defined in `flexinv.typing`; engines' adapters may have their own, as they are independent."""
    if module == "flexinv.typing" or module.startswith("crosscheck.engines"):
        return []
    return [
        f"line {node.lineno}: {node.targets[0].id} is defined again; write from flexinv.typing import {node.targets[0].id}"
        for node in parsed(source).body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in TYPES
    ]


def open_dicts(sources: Mapping[str, str]) -> list[str]:
    """Data have types: a dict of anything stands where its keys really are open (module -> source of one package).

    Counted are its uses and those of its aliases, by which nothing is gained; below the bound there is nothing to say.
    """
    aliases = {"JsonSchemaValue"}  # pydantic's
    for source in sources.values():
        if OPEN in source:
            aliases |= {
                node.targets[0].id
                for node in parsed(source).body
                if isinstance(node, ast.Assign)
                and isinstance(node.targets[0], ast.Name)
                and ast.unparse(node.value) == OPEN
            }
    known = re.compile("|".join(map(re.escape, sorted(aliases))))
    found = []
    for module, source in sources.items():
        if OPEN not in source and not known.search(source):
            continue
        for node in walked(source):
            if (isinstance(node, ast.Subscript) and ast.unparse(node) == OPEN) or (
                isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in aliases
            ):
                found.append(f"{module}, line {node.lineno}")
    if len(found) <= OPEN_DICTS:
        return []
    words = f"{len(found)} times {OPEN}, at most {OPEN_DICTS}; write a dataclass or a TypedDict"
    return [f"{words}: {'; '.join(found)}"]


def machine_paths(text: str) -> list[str]:
    """No file names a folder of somebody's machine."""
    folders = re.compile(r"(?<![\w./$-])/(?:work|root|home|Users)/\w+")
    lines = enumerate(text.splitlines(), 1)
    return [f"line {k}: {result.group()}" for k, line in lines for result in folders.finditer(line)]


@cache
def imports(source: str) -> tuple[tuple[int, str, bool], ...]:
    """Line, dotted name (``from a.b import c`` gives a.b.c), and whether it waits (in a function, or for types)."""
    return tuple(_imports(parsed(source), False))


def _imports(node: ast.AST, waits: bool) -> Iterator[tuple[int, str, bool]]:
    """Imports are statements: what an expression holds is not looked at."""
    if isinstance(node, ast.Import):
        yield from ((node.lineno, alias.name, waits) for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        for alias in node.names:
            yield node.lineno, f"{'.' * node.level}{node.module or ''}.{alias.name}", waits
    elif isinstance(node, _BLOCKS):
        late = isinstance(node, Function) or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        for inner in ast.iter_child_nodes(node):
            yield from _imports(inner, waits or late)


def importers(sources: Mapping[str, str]) -> dict[str, list[str]]:
    """Modules by which each one is imported, also in functions (dotted module -> source)."""
    result: dict[str, list[str]] = {}
    for module, source in sources.items():
        for _, name, _ in imports(source):
            known = next((one for one in (name, name.rpartition(".")[0]) if one in sources), module)
            if known != module:
                result.setdefault(known, []).append(module)
    return result


def _misplaced(module: str, name: str, inside_function: bool) -> str:
    here, there = module.split("."), name.split(".")
    if name.startswith("."):
        return "imports are written in full"
    if here[0] == "flexinv" and there[0] == "crosscheck":
        return "flexinv stands alone"
    if here[0] == "flexinv" and there[0] in GRAPHICS and not (_draws(here) and inside_function):
        return "only the command line draws, and flexinv/display, and loads what draws when it does"
    if _is_command_line(there) and not (_is_command_line(here) or here[-1] == "__main__"):
        return "a command line is imported by nobody"
    own = next((engine for engine in ENGINES if _is_adapter(module, engine)), None)
    if there[0] in ENGINES and there[0] != own:
        return f"only crosscheck/engines/{there[0]}/ may"
    if own and there[0] == "flexinv" and (len(there) < 2 or there[1] not in PRIMARY):
        return f"an adapter reads primary data only ({', '.join(PRIMARY)})"
    other = (*(engine for engine in ENGINES if engine != own), "flexinv")
    if own and name.startswith(tuple(f"crosscheck.engines.{engine}" for engine in other)):
        return "an engine does not know another"
    return ""


def _is_adapter(module: str, engine: str) -> bool:
    return module.startswith(f"crosscheck.engines.{engine}.")


def _is_command_line(parts: list[str]) -> bool:
    return parts[0] in ("flexinv", "crosscheck") and parts[1:2] == ["cli"]


def _draws(parts: list[str]) -> bool:
    return _is_command_line(parts) or parts[:2] == ["flexinv", "display"]


def _module_of(name: str, modules: dict[str, str]) -> str | None:
    """The module that holds ``name``: itself, or the one it was imported from."""
    parent = name.rpartition(".")[0]
    return name if name in modules else parent if parent in modules else None


def _functions(nodes: tuple[ast.AST, ...]) -> Iterator[Function]:
    return (node for node in nodes if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)))


def _public_functions(tree: ast.Module) -> Iterator[tuple[str, Function]]:
    """Public functions of the module, and public methods of its public classes."""
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not node.name.startswith("_"):
            yield "", node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for part in node.body:
                if isinstance(part, (ast.FunctionDef, ast.AsyncFunctionDef)) and not part.name.startswith("_"):
                    yield f"{node.name}.", part


def _has_numbers(function: Function) -> bool:
    """Whether numbers go in or out: by the annotations, and always where there are none (numba's kernels)."""
    a = function.args
    given = [x for x in (*a.posonlyargs, *a.args, *a.kwonlyargs) if x.arg not in ("self", "cls")]
    if function.returns is None or any(x.annotation is None for x in given):
        return True
    words = [ast.unparse(x.annotation) for x in given if x.annotation] + [ast.unparse(function.returns)]
    return any(re.search(r"\b(float|complex|Array\w*|NDArray\[np\.float64\]|Triple|Values)\b", word) for word in words)


def _is_command(function: Function) -> bool:
    """Commands of a command line explain themselves to people in --help."""
    return any(re.search(r"\.(command|callback|group)\b|^click\.", ast.unparse(d)) for d in function.decorator_list)
