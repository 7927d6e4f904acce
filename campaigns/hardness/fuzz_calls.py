"""C code that calls every function of an exported library's header with arguments drawn by lot: `calls.h` of `fuzz.c`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from campaigns.hardness.libraries import Library

# Name of an argument -> how many numbers stand there; what is not here is a fault of this table.
COUNTS = {
    "q": "ARM_NQ", "qd": "ARM_NV", "qdd": "ARM_NV", "tau": "ARM_NV", "gravity": "3", "centre": "3", "inertia": "6", "place": "3",
    "rotation": "9", "wrench": "6", "forces": "6", "strains": "6", "matrix": "ARM_NV * ARM_NV",
}  # fmt: skip
COLUMNS = {"q": "0", "qd": "ARM_NQ", "qdd": "ARM_NQ + ARM_NV"}
_PROTOTYPE = re.compile(r"^(int|size_t|double|const char \*) ?(\w+)\(([^;]*)\);", re.M)


@dataclass(frozen=True)
class Prototype:
    """A function of a header: its name without the library's, what it returns, and its arguments as C has them."""

    name: str
    returned: str
    arguments: tuple[str, ...]


def list_prototypes(library: Library) -> list[Prototype]:
    """Return the functions [-] of a library's header."""
    header = (library.folder / "include" / f"{library.name}.h").read_text(encoding="utf-8")
    found = list[Prototype]()
    for returned, name, inner in _PROTOTYPE.findall(header):
        arguments = () if inner == "void" else tuple(" ".join(one.split()) for one in inner.split(","))
        found.append(Prototype(name.removeprefix(f"{library.name}_"), returned, arguments))
    return found


def write_calls(library: Library) -> str:
    """Return `calls.h` [-]: names of the functions, which of them begin a block, and a call of each."""
    functions = list_prototypes(library)
    names = ", ".join(f'"{one.name}"' for one in functions)
    begins = ", ".join(str(int(one.name.startswith("start"))) for one in functions)
    cases = "\n".join(line for number, one in enumerate(functions) for line in _write_case(number, one))
    return (
        f"enum {{ FUNCTIONS = {len(functions)} }};\n"
        f"static const char *const NAMES[] = {{{names}}};\nstatic const int BEGINS[] = {{{begins}}};\n\n"
        "static int call(size_t function)\n{\n"
        "    int status = -1, right = draw(2) == 0;\n    size_t samples = 1, row = (size_t)draw(row_count);\n"
        f"    switch (function) {{\n{cases}\n    }}\n    (void)samples, (void)row, (void)right;\n    return status;\n}}\n"
    )


def _write_case(number: int, function: Prototype) -> Iterator[str]:
    """The lines of a case: draw each argument, call, give the memory back."""
    yield f"    case {number}: {{"
    if any(one.startswith("size_t samples") for one in function.arguments):
        yield "        samples = (size_t)draw(MOST_SAMPLES);"
    given = list[str]()
    rooms = list[str]()
    for argument in function.arguments:
        kind, _, name = argument.rpartition(" ")
        word = name.lstrip("*")
        kind = (kind + " " + "*" * (len(name) - len(word))).strip()
        drawn = _draw_argument(kind, word)
        if kind in ("double *", "const double *"):
            rooms.append(word)
            yield f"        double *{word} = {drawn};"
            yield f"        double *{word}_given = draw(20) == 0 ? NULL : {word};"
            given.append(f"{word}_given")
        else:
            given.append(drawn)
    called = f"ARM({function.name})({', '.join(given)})"
    yield f"        {'status = ' if function.returned == 'int' else '(void)'}{called};"
    yield "        " + " ".join(f"free({word});" for word in rooms)
    yield "        break;\n    }"


def _draw_argument(kind: str, name: str) -> str:
    """The C expression that draws an argument of a type and name."""
    if kind in ("void *", "const void *"):
        return "begun" if name == "from" else "moved" if name == "to" else "draw_block()"
    if kind == "const double *":
        column = COLUMNS.get(name)
        return f"draw_numbers({COUNTS[name]}, samples, {f'right ? {column} : -1' if column else '-1'}, row)"
    if kind == "double *":
        return f"make_room({COUNTS[name]} * samples)"
    if kind == "size_t":
        return {"samples": "samples", "size": "draw_size()"}.get(name, "draw_index()")
    if kind == "int":
        return "draw_layout()" if name == "layout" else "(int)draw(40) - 10"
    if kind == "double":
        return "fabs(draw_number())" if name == "mass" else "draw_number()"
    raise ValueError(f"no draw for an argument of type {kind!r}: {name}")
