"""Comparison in plain text and in Markdown: what differs, what it does to efforts, and what to write where."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.result import WORDS, Comparison
from crosscheck.report.words import format_short

GROUPS = (
    ("causes", "Differences that torques feel"),
    ("conventions", "Other conventions: the same physics, coordinates that count otherwise"),
    ("limits", "Other limits"),
    ("unseen", "Differences that no torque of this mechanism can tell"),
)


def render_text(comparison: Comparison) -> str:
    """Return the comparison as plain lines."""
    lines = [
        f"A: {comparison.first}",
        f"B: {comparison.second}",
        comparison.sentence,
        f"joints matched: {comparison.matched}",
    ]
    for name, title in GROUPS:
        group: tuple[Difference, ...] = getattr(comparison.judged, name)
        if group:
            lines += [f"{title}:", *(f"  {describe_difference(d)}" for d in group)]
    lines += [*describe_rounding(comparison), describe_repair(comparison)]
    lines += [comparison.suspects] if comparison.suspects else []
    for place, written in comparison.advice:
        lines += [f"{place}:", *(f"  {w}" for w in written)]
    lines += [*comparison.grounds, *(f"note: {note}" for note in comparison.notes)]
    return "\n".join(lines)


def describe_difference(difference: Difference) -> str:
    """Return a difference with its hints and its effect [N m], [N] in a line."""
    parts = [difference.words, *difference.hints]
    if difference.effect:
        parts.append(
            f"changes an effort by {format_short(difference.effect)} N m or N, {format_short(difference.share)} times its range"
        )
    return "; ".join(parts)


def describe_rounding(comparison: Comparison) -> list[str]:
    """Return the line on numbers that differ in what their printed digits leave open; none where there are none."""
    count = len(comparison.judged.rounding)
    if not count:
        return []
    effect = format_short(comparison.judged.rounding_effort)
    return [f"rounding: {count} numbers differ by less than their printed digits; effect {effect} N m or N"]


def describe_repair(comparison: Comparison) -> str:
    """Return the difference of efforts before and after repair, in words."""
    judged = comparison.judged
    added = [d for d in judged.causes if d.family == "feature"]
    if judged.before <= comparison.tolerance and len(judged.causes) == len(added):
        whose = "efforts of the mechanisms" if added else "efforts"
        return f"{whose} agree to {format_short(judged.before)} of their ranges"
    where = f" at joint {judged.worst_joint}" if judged.worst_joint else ""
    difference = f"{format_short(judged.before_effort)} N m or N{where}"
    before = f"efforts differ by up to {difference}, {format_short(judged.before)} times its range"
    return f"{before}; with the differences put right, {format_short(judged.after)} of it is left"


def render_markdown(comparison: Comparison) -> str:
    """Return the comparison for a pull request or the summary of a CI step."""
    return "\n".join(_list_markdown_lines(comparison)) + "\n"


def _list_markdown_lines(comparison: Comparison) -> Iterator[str]:
    yield f"## {'✓' if comparison.equal else '✗'} {format_cell(comparison.sentence)}"
    yield ""
    yield f"A: `{comparison.first}` · B: `{comparison.second}` · joints matched: {format_cell(comparison.matched)}"
    for name, title in GROUPS:
        group: tuple[Difference, ...] = getattr(comparison.judged, name)
        if group:
            yield from ("", f"### {title}", "", *_list_table_lines(group))
    yield ""
    yield from (f"{format_cell(words)}\n" for words in [*describe_rounding(comparison), describe_repair(comparison)])
    if comparison.advice:
        yield "### What to write"
        yield ""
        yield f"{comparison.suspects}\n" if comparison.suspects else ""
    for place, written in comparison.advice:
        yield f"* {format_cell(place)}"
        yield from (f"  * {_format_code(words)}" for words in written)
    yield from (f"* {format_cell(words)}" for words in comparison.grounds)
    yield from (f"* note: {format_cell(note)}" for note in comparison.notes)
    for side, lines in comparison.dropped:
        yield f"\n<details><summary>what was not compared of {format_cell(side)}, and what was taken for it</summary>\n"
        yield from (f"* {format_cell(words)}" for words in lines)
        yield "\n</details>"


def _list_table_lines(group: Iterable[Difference]) -> Iterator[str]:
    yield "| what | where | A | B | size | effect | looks like |"
    yield "|---|---|---|---|--:|--:|---|"
    for d in group:
        effect = f"{format_short(d.effect)} ({format_short(d.share)} times its range)" if d.effect else ""
        size = f"{d.size:.6g} {d.unit}".removesuffix(" -")
        cells = [f"{WORDS[d.family]}: {d.cause}", d.place, d.first, d.second, size, effect, "; ".join(d.hints)]
        yield "| " + " | ".join(map(format_cell, cells)) + " |"


def format_cell(words: str) -> str:
    """Return text as text: nothing in it is Markdown or HTML."""
    for sign in "\\`*_[]|":
        words = words.replace(sign, "\\" + sign)
    return " ".join(words.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").split())


def _format_code(words: str) -> str:
    before, colon, code = words.partition(": ")
    return (
        f"{format_cell(before)}: `{code.replace('`', ' ')}`" if colon and code.startswith("<") else format_cell(words)
    )
