"""Read TOML tables into validated data; every complaint says where, what was given, expected, and what to write."""

from __future__ import annotations

import datetime
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from flexinv.errors import InputError
from flexinv.files.unit_keys import correction
from flexinv.validation import nearest

LARGEST_FILE = 1 << 20  # [byte]: the largest hand-written mechanism is a thousand times smaller
LARGEST = 1e30  # no length, mass or stiffness in SI is larger; powers of larger numbers overflow
LONGEST_NAME, LONGEST_TEXT = 100, 4000  # [characters]
FORMAT = 1  # of mechanism.toml and cases.toml; a change that an older version would misread raises it


class Table(BaseModel):
    """A TOML table: nothing is converted silently, no key is ignored."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


T = TypeVar("T", bound=Table)


def key(expected: str, write: str, **rules: Any) -> Any:
    """Declare a key of a table by the words of its complaint: what is expected [unit] and an example to write."""
    return Field(description=expected, examples=[write], **rules)


def bounded(value: Any) -> Any:
    """Refuse (ValueError) what is no finite number of a size that can be meant, at most ``LARGEST`` [any unit]."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("should be a number")
    if value != value or abs(value) > LARGEST:
        raise ValueError(f"should be a finite number, at most {LARGEST:g} in size")
    return value


def _known_format(version: int) -> int:
    if version != FORMAT:
        raise ValueError(f"this version of flexinv reads format {FORMAT}; a newer format needs a newer flexinv")
    return version


def _clean_name(name: str) -> str:
    if not name.isprintable() or not name.strip() or len(name) > LONGEST_NAME:
        raise ValueError(f"a name is 1 to {LONGEST_NAME} printable characters, none of them a control character")
    return name


def _clean_text(text: str) -> str:
    if not text.strip() or len(text) > LONGEST_TEXT:
        raise ValueError(f"a text is 1 to {LONGEST_TEXT} characters and not only blanks")
    if not all(c.isprintable() or c == "\n" for c in text):
        raise ValueError("a text has no control characters")
    return text


Format = Annotated[int, AfterValidator(_known_format)]
Number = Annotated[float, BeforeValidator(bounded)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Name = Annotated[str, AfterValidator(_clean_name)]
Text = Annotated[str, AfterValidator(_clean_text)]


def complaint(where: str, given: str, expected: str, write: str) -> str:
    """Lay out one complaint [-]: the place on the first line, then what was given, expected, and what to write."""
    return f"{where}\n  given:    {given}\n  expected: {expected}\n  write:    {write}"


def location(file: Path, table: str, key: str = "") -> str:
    """Name a place in a file [-]: ``models/arm/mechanism.toml: table [links.upper], key length_m``."""
    table = f"table [{table}]" if table else "the top of the file"
    return f"{file}: {table}" + (f", key {key}" if key else "")


def toml_text(value: Any, longest: int = 80) -> str:
    """Write a value as TOML would show it, cut after ``longest`` [characters]."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, dict):
        text = "{ " + ", ".join(f"{k} = {toml_text(v)}" for k, v in list(value.items())[:20]) + " }"
    elif isinstance(value, list):
        text = "[" + ", ".join(toml_text(v) for v in value[:20]) + "]"
    elif isinstance(value, str):
        text = '"' + value[: longest + 1].encode("unicode_escape").decode("ascii") + '"'
    elif isinstance(value, int) and abs(value) > 1 << 1000:
        text = "a very large integer"
    else:
        text = value.isoformat() if isinstance(value, datetime.date) else repr(value)
    return text if len(text) <= longest else text[: longest - 4] + " ..."


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file as data, at most ``LARGEST_FILE`` [byte] of UTF-8; InputError names what is wrong."""
    advice = "a TOML file that this reader knows, see models/README.md"
    if not path.is_file():
        raise InputError(complaint(str(path), "no such file", "a TOML file", _existing(path)))
    with path.open("rb") as stream:
        data = stream.read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        given, most = f"more than {LARGEST_FILE} bytes", f"at most {LARGEST_FILE} bytes"
        raise InputError(complaint(str(path), given, most, "sampled motions as CSV; geometry is not needed at all"))
    try:
        return tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(
            complaint(str(path), f"byte {error.start} is not UTF-8", advice, "the file in UTF-8")
        ) from None
    except RecursionError:
        raise InputError(
            complaint(str(path), "nesting without end", advice, "tables at most a few levels deep")
        ) from None
    except ValueError as error:
        given = re.sub(r"\('(.*?)',?\)", lambda m: "[" + m[1].replace("', '", ".") + "]", str(error))
        raise InputError(complaint(str(path), given, "TOML, each table and key once", _syntax(given))) from None


def check_names(file: Path, **tables: dict[str, Any]) -> None:
    """Check the names of tables [-]: 1 to 100 printable characters, no slash (series are named by paths)."""
    for kind, names in tables.items():
        for name in names:
            try:
                _clean_name(name)
                if "/" in name:
                    raise ValueError("a name has no slash: results are named by paths such as torque/elbow")
            except ValueError as error:
                given = f"the name {toml_text(name)}"
                raise InputError(
                    complaint(f"{file}: tables [{kind}.NAME]", given, str(error), f"[{kind}.arm_1]")
                ) from None


def _existing(path: Path) -> str:
    folder = path.parent if path.parent.is_dir() else path.parent.parent
    names = sorted(p.parent.name for p in folder.glob(f"*/{path.name}")) if folder.is_dir() else []
    near = nearest(path.parent.name, names)
    return f"{folder / near}" if near else f"the path of a folder that has a {path.name}"


def _syntax(message: str) -> str:
    if "declare" in message or "overwrite" in message:
        return "a link, joint, section or case once; give the second one a name of its own"
    return "TOML as on https://toml.io: strings in quotes, numbers without units, true and false in lower case"


def validate(model: type[T], data: Any, file: Path, table: str) -> T:
    """Check one table against its model; InputError carries a complaint for each key that is wrong [-]."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False)
    if not isinstance(data, dict):
        given = toml_text(data)
        raise InputError(complaint(location(file, table), given, "a table of keys", f"[{table}] and its keys below"))
    complaints = [_explained(model, e, file, table) for e in found]
    fixed = {new for _, new in complaints if new}
    kept = [text for (text, _), e in zip(complaints, found, strict=True) if not _is_fixed(e, fixed)]
    raise InputError("\n".join(kept[:5] + ([f"... and {len(kept) - 5} more"] if len(kept) > 5 else [])))


def _is_fixed(error: Any, fixed: set[str]) -> bool:
    return error["type"] == "missing" and ".".join(map(str, error["loc"])) in fixed


def _explained(model: type[Table], error: Any, file: Path, table: str) -> tuple[str, str]:
    """One complaint, and the missing key that it already tells to write."""
    loc = list(error["loc"])
    index = ""
    while isinstance(loc[-1], int):
        index = f"[{loc.pop()}]{index}"
    name, inner = loc[-1], _path(table, loc[:-1])
    owner, info = _field(model, [part for part in loc if isinstance(part, str)])
    where = location(file, inner, name)
    if error["type"] == "extra_forbidden":
        return _unknown(owner, name, error["input"], where, loc)
    expected, write = (info.description or "", info.examples[0]) if info and info.examples else (error["msg"], name)
    if error["type"] == "missing":
        return complaint(where, "nothing", expected, write), ""
    said = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    given = f"{name}{index} = {toml_text(error['input'])}  ({said[0].lower()}{said[1:]})"
    return complaint(where, given, expected, write), ""


def _path(table: str, loc: list[Any]) -> str:
    parts = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return (table + parts).removeprefix(".")


def _unknown(owner: type[Table], name: str, value: Any, where: str, loc: list[Any]) -> tuple[str, str]:
    known = list(owner.model_fields)
    given = f"{name} = {toml_text(value)}"
    better = correction(name, value, known)
    if better:
        right, number = better
        info = owner.model_fields[right]
        write = f"{right} = {toml_text(number)}" if number is not None else (info.examples or [right])[0]
        expected = f"{right}, {info.description} (a key ends in its unit)"
        return complaint(where, given, expected, write), ".".join(map(str, [*loc[:-1], right]))
    near = nearest(name, known)
    advice = f"{near} instead of {name}" if near else "one of these, or remove it"
    fixed = ".".join(map(str, [*loc[:-1], near])) if near else ""
    return complaint(where, given, f"one of {', '.join(known)}", advice), fixed


def _field(model: type[Table], keys: list[str]) -> tuple[type[Table], FieldInfo | None]:
    """Follow a path of keys through nested tables: the table that owns the last key, and what is known of it."""
    owner, info = model, None
    for depth, name in enumerate(keys):
        info = owner.model_fields.get(name)
        inner = _table_in(info.annotation) if info else None
        if inner is None or depth == len(keys) - 1:
            break
        owner = inner
    return owner, info


def _table_in(annotation: Any) -> type[Table] | None:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((t for t in map(_table_in, get_args(annotation)) if t), None)
