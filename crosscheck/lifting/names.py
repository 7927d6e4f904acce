"""Names that stand twice: formats with nested models allow them below different parents; here each part has one of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

SHOWN = 4


def unique_names(plain: Sequence[str], paths: Sequence[str], reserved: Collection[str] = ()) -> list[str]:
    """Return a name for each part [-]: its own where it stands once, else its path, with underlines where that is taken.

    plain, paths : of each part, the path that of its model and itself; reserved : names that no part may have
    """
    counts = Counter(plain)
    once = {name for name in plain if counts[name] == 1 and name not in reserved}
    taken = once | set(reserved)
    result = []
    for name, path in zip(plain, paths, strict=True):
        if name not in once:
            name = _make_free_name(path, taken)
            taken.add(name)
        result.append(name)
    return result


def name_words(kind: str, plain: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return a line for each name that stands more than once [-]: what its parts are called instead.  kind : "joints"."""
    groups: dict[str, list[str]] = {}
    for word, name in zip(plain, names, strict=True):
        groups.setdefault(word, []).append(name)
    lines = []
    for word, several in groups.items():
        if several == [word]:
            continue
        shown = ", ".join(several[:SHOWN]) + (", ..." if len(several) > SHOWN else "")
        lines.append(f"name {word} of {len(several)} {kind}: called by their paths, {shown}")
    return lines


def _make_free_name(name: str, used_names: Collection[str]) -> str:
    while name in used_names:
        name += "_"
    return name
