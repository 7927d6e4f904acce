"""Read TOML tables into validated data; every complaint says where, what was given, expected, and what to write."""

from __future__ import annotations

import datetime
import re
import tomllib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from flexinv import validation as arguments
from flexinv.errors import InputError
from flexinv.files.regular_files import NotRegularFile, read_regular
from flexinv.files.values import FORMAT, check_name, find_correction

LARGEST_FILE = 1 << 20  # [byte]: the largest hand-written mechanism is a thousand times smaller
LONGEST_PATH = 4096  # [characters]: the LONGEST_SHOWN that Linux takes
# Keys of fifty parts and more, which the parser takes a time for that grows with their square; a mechanism has three.
LONG_KEY = re.compile(rb"""(?:^|[\[{,])[ \t]*(?:[\w"'-]+[ \t]*\.[ \t]*){50}""", re.MULTILINE)
# Examples that are a whole line: the head of a table, or a key and its value.
COMPLETE = re.compile(r"\[+[a-z][^\s,\]]*\]+|[\w.]+ = ")


class Table(BaseModel):
    """A TOML table: nothing is converted silently, no key is ignored.

    Its validator is built with the first table that it reads, as few programs read all kinds of tables; see `build_validators`.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True, defer_build=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Put the name of its key before each example that is a value alone."""
        for name, info in cls.model_fields.items():
            info.examples = [one if COMPLETE.match(one) else f"{name} = {one}" for one in info.examples or []]


T = TypeVar("T", bound=Table)


def make_key(expected: str, write: str, default: Any = ...) -> Any:
    """Declare a key of a table by the words of its complaint: what is expected [unit] and an example of its value (or a line)."""
    return Field(default, description=expected, examples=[write])


def make_optional_key(expected: str, write: str) -> Any:
    """Declare a key that may be absent, which is None then: as `make_key` what is expected [unit] and an example."""
    return make_key(expected, write, None)


def read_option(data: Any, where: Location, name: str, known: Collection[str], expected: str, default: str) -> str:
    """Return the value of the key that decides what a table is [-], ``""`` where it is absent; InputError for an unknown one."""
    value = data.get(name) if isinstance(data, dict) else None
    if value is not None and (not isinstance(value, str) or value not in known):
        write = f'{name} = "{arguments.find_nearest_word(str(value), known) or default}"'
        raise where.make_error(name, f"{name} = {format_toml(value)}", expected, write)
    return value or ""


def read_bytes(path: Path, largest: int, kind: str, existing: str, smaller: str) -> bytes:
    """Read a regular file of at most ``largest`` [byte]; InputError says what else it is, or how to make it smaller."""
    try:
        data = read_regular(path, largest)
    except NotRegularFile as error:
        raise make_input_error(str(path)[:LONGEST_PATH], str(error), kind, existing) from None
    if len(data) > largest:
        raise make_input_error(str(path), f"more than {largest} bytes", f"at most {largest} bytes", smaller)
    return data


def make_input_error(where: str, given: str, expected: str, write: str) -> InputError:
    """Return the error [-] that names a place on its first line, then what was given, expected, and what to write."""
    return InputError(f"{where}\n  given:    {given}\n  expected: {expected}\n  write:    {write}")


@dataclass(frozen=True)
class Location:
    """Place in a file: the table of this path, or the top of the file."""

    file: Path
    table: str = ""

    def make_inner_location(self, name: str) -> Location:
        """Return the location of a table inside this one [-]."""
        return Location(self.file, f"{self.table}.{name}".removeprefix("."))

    def describe_key(self, name: str = "") -> str:
        """Return the words for a key or the table [-]: ``models/arm/mechanism.toml: table [links.upper], key length_m``."""
        table = f"table [{self.table}]" if self.table else "the top of the file"
        return f"{self.file}: {table}" + (f", key {name}" if name else "")

    def make_error(self, key: str, given: str, expected: str, write: str) -> InputError:
        """Return the `make_input_error` [-] about a key, ``""`` for the table itself."""
        return make_input_error(self.describe_key(key), given, expected, write)


LONGEST_SHOWN = 80  # characters of a value that an error shows


def format_toml(value: Any) -> str:
    """Write a value as TOML would show it, cut after LONGEST_SHOWN [characters]."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, dict):
        text = "{ " + ", ".join(f"{k} = {format_toml(v)}" for k, v in list(value.items())[:20]) + " }"
    elif isinstance(value, list):
        text = "[" + ", ".join(format_toml(v) for v in value[:20]) + "]"
    elif isinstance(value, str):
        text = '"' + value[: LONGEST_SHOWN + 1].encode("unicode_escape").decode("ascii") + '"'
    elif isinstance(value, int) and abs(value) > 1 << 1000:
        text = "a very large integer"
    else:
        text = value.isoformat() if isinstance(value, datetime.date) else repr(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 4] + " ..."


ROBOT_FILES = (".urdf", ".xml", ".sdf", ".usd", ".usda", ".usdc", ".xacro")


def resolve_toml_file(path: str | Path, name: str) -> Path:
    """Return the file that a folder or a file name means [-]: ``models/arm`` -> ``models/arm/mechanism.toml``."""
    path = Path(arguments.check_path("path", path, f"a folder that has a {name}"))
    if path.suffix in ROBOT_FILES and path.is_file():
        given = "a robot file, which states no motion and none of what only a mechanism.toml says"
        write = (
            f'a folder with a mechanism.toml that has the line urdf = "{path.name}", and a cases.toml with the motion'
        )
        if path.suffix != ".urdf":
            write = "a mechanism.toml; what the file says of the robot, crosscheck compare reads"
        raise make_input_error(str(path), given, f"a folder that has a {name}", write)
    if path.suffix in ROBOT_FILES and not path.exists():
        raise make_input_error(
            str(path), "there is no such file", f"a folder that has a {name}", "the path of such a folder"
        )
    return path if path.suffix == ".toml" else path / name


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file as data, at most ``LARGEST_FILE`` [byte] of UTF-8; InputError names what is wrong."""
    advice = "a TOML file that this reader knows, see models/README.md"
    smaller = "sampled motions as CSV; geometry is not needed at all"
    folder = path.parent if path.parent.is_dir() else path.parent.parent
    names = sorted(p.parent.name for p in folder.glob(f"*/{path.name}")) if folder.is_dir() else []
    near = arguments.find_nearest_word(path.parent.name, names)
    existing = f"{folder / near}" if near else f"the path of a folder that has a {path.name}"
    data = read_bytes(path, LARGEST_FILE, "a TOML file", existing, smaller)
    if LONG_KEY.search(data):
        raise make_input_error(str(path), "a key of more than 50 parts", advice, "tables at most a few levels deep")
    try:
        tables = tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise make_input_error(str(path), f"byte {error.start} is not UTF-8", advice, "the file in UTF-8") from None
    except RecursionError:
        raise make_input_error(str(path), "nesting without end", advice, "tables at most a few levels deep") from None
    except ValueError as error:
        given = re.sub(r"\('(.*?)',?\)", lambda m: "[" + m[1].replace("', '", ".") + "]", str(error))
        write = "TOML as on https://toml.io: strings in quotes, numbers without units, true and false in lower case"
        if "declare" in given or "overwrite" in given:
            write = "a link, joint, section or case once; give the second one a name of its own"
        raise make_input_error(str(path), given, "TOML, each table and key once", write) from None
    said = tables.get("format", FORMAT)
    if isinstance(said, int) and said > FORMAT:  # before all else: other keys may mean something else in a newer format
        given = f"format = {format_toml(said)}"
        expected = f"format {FORMAT} or older: this flexinv knows no newer one"
        write = "the file in this format, or install a newer flexinv, which reads it"
        raise Location(path).make_error("format", given, expected, write)
    return tables


def check_table_names(file: Path, **tables: dict[str, Any]) -> None:
    """Check the names of tables [-]: 1 to 100 printable characters, no slash (series are named by paths)."""
    for kind, names in tables.items():
        for name in names:
            try:
                check_name(name)
                if "/" in name:
                    raise ValueError("a name has no slash: results are named by paths such as torque/elbow")
            except ValueError as error:
                given = f"the name {format_toml(name)}"
                raise make_input_error(f"{file}: tables [{kind}.NAME]", given, str(error), f"[{kind}.arm_1]") from None


def build_validators() -> None:
    """Build the validators of all kinds of tables [-] that are imported, for a process from which others are forked."""
    ahead = [Table]
    while ahead:
        table = ahead.pop()
        table.model_rebuild()
        ahead += table.__subclasses__()


def check_table(model: type[T], data: Any, where: Location) -> T:
    """Check one table against its model; InputError carries a complaint for each key that is wrong [-]."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = _join_branches(error.errors(include_url=False, include_context=False))
    if not isinstance(data, dict):
        raise where.make_error("", format_toml(data), "a table of keys", f"[{where.table}] and its keys below")
    complaints = [_describe_error(model, e, where) for e in found]
    fixed = {new for _, new in complaints if new}
    said = [e["type"] == "missing" and ".".join(map(str, e["loc"])) in fixed for e in found]
    kept = [text for (text, _), twice in zip(complaints, said, strict=True) if not twice]
    raise InputError("\n".join(kept[:5] + ([f"... and {len(kept) - 5} more"] if len(kept) > 5 else [])))


def _join_branches(found: list[Any]) -> list[Any]:
    """Errors of keys that take a number or a list of them: those of what was written, without the names of both branches."""
    out = []
    for error in found:
        branches = [part for part in error["loc"] if isinstance(part, str) and part.startswith(("list[", "function-"))]
        of_list = any(part.startswith("list[") for part in branches)
        if branches and (error["type"] == "list_type" if of_list else isinstance(error["input"], list)):
            continue
        out.append({**error, "loc": tuple(part for part in error["loc"] if part not in branches)})
    return out


def _describe_error(model: type[Table], error: Any, top: Location) -> tuple[str, str]:
    """One complaint, and the missing key that it already tells to write."""
    loc = list(error["loc"])
    index = ""
    while isinstance(loc[-1], int):
        index = f"[{loc.pop()}]{index}"
    parts = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc[:-1])
    name = loc[-1]
    inner = Location(top.file, (top.table + parts).removeprefix("."))
    owner, info = _find_field(model, [part for part in loc if isinstance(part, str)])
    if error["type"] == "extra_forbidden":
        complaint, instead = _describe_unknown_key(owner, name, error["input"], inner)
        return complaint, ".".join(map(str, [*loc[:-1], instead])) if instead else ""
    expected, write = (info.description or "", info.examples[0]) if info and info.examples else (error["msg"], name)
    if error["type"] == "missing":
        return str(inner.make_error(name, "nothing", expected, write)), ""
    said = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    given = f"{name}{index} = {format_toml(error['input'])}  ({said[0].lower()}{said[1:]})"
    return str(inner.make_error(name, given, expected, write)), ""


def _describe_unknown_key(owner: type[Table], name: str, value: Any, where: Location) -> tuple[str, str]:
    """The complaint about a key that a table does not have, and the one that it tells to write, or "" without one."""
    known = list(owner.model_fields)
    given = f"{name} = {format_toml(value)}"
    better = find_correction(name, value, known)
    if better:
        right, number = better
        info = owner.model_fields[right]
        write = f"{right} = {format_toml(number)}" if number is not None else (info.examples or [right])[0]
        expected = f"{right}, {info.description} (a key ends in its unit)"
        return str(make_input_error(where.describe_key(name), given, expected, write)), right
    near = arguments.find_nearest_word(name, known) or ""
    advice = f"{near} instead of {name}" if near else "one of these, or remove it"
    return str(make_input_error(where.describe_key(name), given, f"one of {', '.join(known)}", advice)), near


def _find_field(model: type[Table], keys: list[str]) -> tuple[type[Table], FieldInfo | None]:
    """Follow a path of keys through nested tables: the table that owns the last key, and what is known of it."""
    info = model.model_fields.get(keys[0])
    inner = _find_table(info.annotation) if info and len(keys) > 1 else None
    return (model, info) if inner is None else _find_field(inner, keys[1:])


def _find_table(annotation: Any) -> type[Table] | None:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((t for t in map(_find_table, get_args(annotation)) if t), None)
