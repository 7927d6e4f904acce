"""Pages that are written from the project itself when the site is built: mechanisms, engines, causes, keys of files.

Each is rendered by a template of docs/templates from what the packages say of themselves; none is kept in the repository.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.display import progress_message, status_iterator

from crosscheck.causes.dictionary import DICTIONARY, TABLES
from crosscheck.corpus.notes import CorpusTable
from crosscheck.doors.config import ConfigTable, EngineRow
from crosscheck.engines import ENGINES
from crosscheck.identification.settings import IdentifyTable
from crosscheck.kit.schemas import OURS, described, schema
from crosscheck.verdicts.plan import Task, discover
from crosscheck.workflows.model_summary import picture, portrait, small
from flexinv.errors import FlexinvError

DOCS = Path(__file__).resolve().parent.parent
ROOT = DOCS.parent
MODELS = ROOT / "models"
PICTURES = DOCS / "_build" / "pictures"  # drawn once for the same files
ROW = re.compile(r"^\| \[(\w+)\]\(\w+\) \| (.+?) \| (.+?) \| (.+?) \|$", re.M)
# Files that people write beside those of the schemas: name -> the table that is the file, and those that it reads later.
FILES: dict[str, tuple[type[BaseModel], ...]] = {
    "identify": (IdentifyTable,),
    "corpus": (CorpusTable,),
    "crosscheck": (ConfigTable, EngineRow),
}
_templates = jinja2.Environment(
    loader=jinja2.FileSystemLoader(DOCS / "templates"), trim_blocks=True, lstrip_blocks=True, autoescape=False,
    undefined=jinja2.StrictUndefined,
)  # fmt: skip


def write(app: Sphinx, config: Any) -> None:
    """Write all generated pages into docs/mechanisms and docs/reference/generated."""
    for folder in ("mechanisms", "reference/generated"):
        shutil.rmtree(DOCS / folder, ignore_errors=True)
        (DOCS / folder).mkdir(parents=True)
    write_mechanisms()
    with progress_message("writing the pages of engines, causes and files"):
        _page("reference/generated/engines.md", "engines.md.j2", engines=ENGINES.values(), gives=_compared())
        _page("reference/generated/causes.md", "causes.md.j2", tables=_causes(), count=len(DICTIONARY))
        said: dict[str, tuple[type[BaseModel], Any]] = {
            name: (root, schema(name)["$defs"]) for name, (root, _) in OURS.items()
        }
        said |= {name: (tables[0], described(tables)) for name, tables in FILES.items()}
        for name, (root, parts) in said.items():
            tables = keys(parts, root.__name__)
            _page(f"reference/generated/{name}.md", "keys.md.j2", file=f"{name}.toml", tables=tables)


def write_mechanisms() -> None:
    """Write one page for every mechanism of models/, and their list."""
    known = {name: words for name, *words in ROW.findall((MODELS / "README.md").read_text())}
    plan = discover(MODELS)
    if plan.broken:
        raise RuntimeError(f"models cannot be read: {plan.broken}")
    tasks: dict[str, list[Task]] = {}
    for task in plan.tasks:
        tasks.setdefault(task.folder.name, []).append(task)
    for name in status_iterator(sorted(tasks), "drawing mechanisms... ", "darkgreen", len(tasks)):
        first = tasks[name][0]
        tests, source, answer = (_linked(words) for words in known[name])
        _page(
            f"mechanisms/{name}.md", "mechanism.md.j2", name=name, title=first.mechanism.title or name, tests=tests,
            source=source, answer=answer, cases=[task.case for task in tasks[name]], summary=drawn(first),
            matrix=matrix(name),
        )  # fmt: skip
    _page("mechanisms/index.md", "mechanisms.md.j2", names=sorted(tasks), known=known)


def drawn(task: Task) -> list[tuple[str, str]]:
    """Draw a mechanism (docs/mechanisms/NAME.png, small NAME.svg) and return words about it; both are kept for the same files."""
    name = task.folder.name
    said = b"".join(path.read_bytes() for path in sorted(task.folder.glob("*.toml")))
    kept = PICTURES / f"{name}-{hashlib.sha256(said).hexdigest()[:16]}"
    image, words, sketch = (kept.with_suffix(end) for end in (".png", ".txt", ".svg"))
    if not (image.exists() and words.exists() and sketch.exists()):
        PICTURES.mkdir(parents=True, exist_ok=True)
        try:
            seen = portrait(task)
        except FlexinvError as error:
            raise RuntimeError(f"{name} cannot be drawn: {error}") from error
        picture(seen, image)
        sketch.write_text(small(seen))
        words.write_text("\n".join(f"{what}\t{text}" for what, text in seen.lines))
    shutil.copy(image, DOCS / "mechanisms" / f"{name}.png")
    shutil.copy(sketch, DOCS / "mechanisms" / f"{name}.svg")
    return [(what, text) for what, _, text in (line.partition("\t") for line in words.read_text().splitlines())]


def matrix(name: str) -> list[list[str]]:
    """Return a table of the blessed night: largest difference from the reference by quantity (rows) and engine."""
    found = _baseline()
    found = found[found.mechanism == name]
    if found.empty:
        return []
    wide = found.pivot_table(index=["quantity", "unit"], columns="engine", values="fraction", aggfunc="max")
    rows = [["quantity", *wide.columns]]
    for (quantity, unit), values in wide.iterrows():
        rows.append([f"{quantity} [{unit}]", *("" if pd.isna(v) else f"{v:.0e}" for v in values)])
    return rows


def keys(parts: dict[str, Any], root: str) -> list[tuple[str, str, list[tuple[str, str, str, str]]]]:
    """Return the tables of a file from their JSON Schemas: name, description, rows of key, kind, needed, description.

    root : name of the table that is the file; it comes first
    """
    tables = []
    for name, part in sorted(parts.items(), key=lambda item: (item[0] != root, item[0])):
        needed = part.get("required", ())
        rows = [
            (key, _kind(said), "needed" if key in needed else "", _cell(said.get("description", "")))
            for key, said in part.get("properties", {}).items()
        ]
        if rows:
            tables.append((_named(name), _cell(part.get("description", "")), rows))
    return tables


def _kind(said: dict[str, Any]) -> str:
    """Return what a value may be, in words."""
    if "$ref" in said:
        return "table " + _named(said["$ref"].rpartition("/")[2])
    if "const" in said:
        return f'`"{said["const"]}"`'
    if "enum" in said:
        return ", ".join(f'`"{value}"`' for value in said["enum"])
    if "anyOf" in said:
        return " or ".join(dict.fromkeys(_kind(part) for part in said["anyOf"] if part.get("type") != "null"))
    kind = str(said.get("type", "any"))
    if kind == "array" and isinstance(said.get("items"), dict):
        return f"list of {_kind(said['items'])}"
    return {"object": "tables", "array": "list"}.get(kind, kind)


def _named(table: str) -> str:
    return table.removesuffix("Table").removesuffix("Row")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _linked(text: str) -> str:
    """Return a cell of models/README.md with its file names as they stand."""
    return re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", text).strip()


def _baseline() -> pd.DataFrame:
    return pd.read_csv(ROOT / "reports" / "baseline" / "metrics.csv")


def _compared() -> dict[str, list[str]]:
    """Return the quantities that each engine was compared in, in the blessed night."""
    return {engine: sorted(set(rows.quantity)) for engine, rows in _baseline().groupby("engine")}


def _causes() -> list[tuple[str, list[Any]]]:
    return [((table.__doc__ or "").splitlines()[0], list(table.ROWS)) for table in TABLES]


def _page(file: str, template: str, /, **values: Any) -> None:
    (DOCS / file).write_text(_templates.get_template(template).render(**values))


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before Sphinx looks for them."""
    app.connect("config-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
