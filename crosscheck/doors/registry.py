"""All engines that a project has: our own, those of installed packages, of ``crosscheck.toml``, of records, and named ones."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from crosscheck.doors import config, packages, record, trust
from crosscheck.doors.fmu_description import INSTALL, PLACE
from crosscheck.doors.program_files import compute_digests, list_changes
from crosscheck.engines import ENGINES, Engine
from crosscheck.measures.record import compute_fingerprint
from crosscheck.verdicts.plan import Plan, Task
from flexinv.errors import InputError

SHOWN = 5  # changed files that a message names
COMMAND = "crosscheck.doors.command"
FMU = "crosscheck.doors.fmu"
RECORD = "crosscheck.doors.record"


@dataclass(frozen=True)
class Program:
    """A program of crosscheck.toml: what is run, in words; trust is given to its settings and its files, by a digest each."""

    name: str
    words: str
    settings: str
    files: Mapping[str, str]

    @property
    def trusted_parts(self) -> dict[str, str]:
        """Return a digest of everything that is trusted: of the settings under the name "", of every file under its path."""
        return {"": self.settings, **self.files}


@dataclass(frozen=True)
class ProjectEngines:
    """The engines of a project by name, and the programs among them; config : the file that names them, None without one."""

    engines: Mapping[str, Engine]
    programs: tuple[Program, ...] = ()
    config: Path | None = None

    def check_trust(self, chosen: Iterable[str], trusting: bool, say: Callable[[str], None]) -> None:
        """Say what is run of the chosen engines; InputError where a program among them is not trusted.

        trusting : they are trusted for this time (in CI, where the repository is what is trusted)
        """
        wanted = set(chosen)
        for program in self.programs:
            if program.name not in wanted:
                continue
            assert self.config is not None
            if not trusting and (why := self._find_distrust(program)):
                raise InputError(
                    f"{self.config} has the engine {program.name}, which {why}: it runs  {program.words}  "
                    "on this machine. Look at it; then write crosscheck trust (in CI: --trust-commands), or leave it out"
                )
            say(f"{program.name} runs  {program.words}  ({self.config})")

    def _find_distrust(self, program: Program) -> str:
        """Return the reason why a program is not trusted, "" where it is."""
        assert self.config is not None
        known = trust.read_trusted_parts(self.config, program.name)
        if known is None:
            return "is new or has changed"
        if known == program.trusted_parts:
            return ""
        changes = [words or "" for words in list_changes(known, program.trusted_parts)]
        files = [words for words in changes if not words.startswith(" ")]
        shown = ", ".join(files[:SHOWN]) + (f" and {len(files) - SHOWN} more" if len(files) > SHOWN else "")
        return f"has changed ({shown})" if files else "is new or has changed"


def collect_doors(models: Path, path: Path | None = None, named: Iterable[str] = ()) -> ProjectEngines:
    """Return the engines of a folder of models.

    path : crosscheck.toml where it is not searched; named : engines as ``module:name``
    Raises InputError where a file is refused or two engines have one name.
    """
    engines = dict(ENGINES)
    _add(engines, packages.list_installed_engines().values(), "an installed package")
    file = config.find_config(models, path)
    programs = []
    for name, row in ({} if file is None else config.read_rows(file)).items():
        assert file is not None
        if row.command is None and row.fmu is None and row.python is None:
            engines[name] = _add_package_limits(name, row, engines, file)
            continue
        engine, program = _make_engine(name, row, file)
        _add(engines, [engine], str(file))
        programs.append(program)
    _add(
        engines,
        (Engine(name, RECORD, "", "", exports=False, settings={}) for name in record.list_engine_names(models)),
        f"{models}/*/records",
    )
    _add(engines, (packages.resolve_reference(reference, Path.cwd()) for reference in named), "--engine")
    return ProjectEngines(engines, tuple(programs), file)


def _add(engines: dict[str, Engine], more: Iterable[Engine], where: str) -> None:
    for engine in more:
        if engine.name in engines:
            raise InputError(f"{where}: an engine is called {engine.name!r}, which is taken; give it another name")
        engines[engine.name] = engine


def _add_package_limits(name: str, row: config.EngineRow, engines: Mapping[str, Engine], file: Path) -> Engine:
    """Return the engine of an installed package with limits that crosscheck.toml states for it."""
    if name in ENGINES:
        raise InputError(
            f"{file}: [engines.{name}] states limits of an engine of this project: write them into cases.toml of each mechanism"
        )
    if name not in engines:
        raise InputError(
            f"{file}: [engines.{name}] has limits alone, and no installed package brings an engine of that name; install it, or "
            'write one of command, fmu and python: command = ["./mine", "{kit}", "{out}"]'
        )
    return replace(engines[name], limits=config.list_limits(name, row))


class DoorSettings(TypedDict):
    """Settings of an engine of crosscheck.toml; folder : of that file; of a program command and refine, or the path of an FMU."""

    folder: str
    cases: list[str]
    version: str
    abilities: str
    command: NotRequired[list[str]]
    refine: NotRequired[bool]
    fmu: NotRequired[str]


def _make_engine(name: str, row: config.EngineRow, file: Path) -> tuple[Engine, Program]:
    """Return an engine of crosscheck.toml and what is trusted with it."""
    folder = file.parent
    told: DoorSettings = {
        "folder": str(folder),
        "cases": list(row.cases),
        "version": row.version,
        "abilities": row.abilities,
    }
    if row.command is not None:
        told["command"] = list(row.command)
        told["refine"] = row.refine
        engine = Engine(name, COMMAND, "", "", exports=True, settings=told)
        files = compute_digests(_list_named(row.command, folder), folder)
        program = Program(name, shlex.join(row.command), _compute_digest(told), files)
        return replace(engine, limits=config.list_limits(name, row)), program
    if row.fmu is not None:
        path = folder / row.fmu
        every = _list_fmus(folder, row.fmu)
        if not every:
            raise InputError(f'{file}: [engines.{name}] fmu = "{row.fmu}": expected a file inside {folder}')
        told["fmu"] = str(path)
        engine = Engine(name, FMU, "fmpy", INSTALL, exports=False, settings=told)
        contents = {one.relative_to(folder).as_posix(): hashlib.sha256(one.read_bytes()).hexdigest() for one in every}
        program = Program(name, f"the native code in {path.name}", _compute_digest(told), contents)
        return replace(engine, limits=config.list_limits(name, row)), program
    engine = packages.resolve_reference(f"{name}={row.python}", folder)
    files = compute_digests(_list_modules(str(row.python), folder), folder)
    program = Program(name, f"the Python object {row.python}", engine.module, files)
    return replace(engine, limits=config.list_limits(name, row)), program


def _list_named(words: Iterable[str], folder: Path) -> list[Path]:
    """Return the files that a command names: words that are files, ``python -m MODULE``, ``--script=FILE``."""
    named = []
    words = list(words)
    for word, before in zip(words, ["", *words], strict=False):
        texts = [word, word.partition("=")[2]] if "=" in word else [word]
        named += [folder / text for text in texts if text and (folder / text).is_file()]
        if before == "-m":
            named += _list_modules(word, folder)
    return named


def _list_modules(reference: str, folder: Path) -> list[Path]:
    """Return the file of a module that lies in a folder: ``my_engine``, ``my.engine:Mine``."""
    parts = reference.partition(":")[0].split(".")
    stem = folder.joinpath(*parts)
    return [file for file in (stem.with_suffix(".py"), stem / "__init__.py", stem / "__main__.py") if file.is_file()]


def _list_fmus(folder: Path, stated: str) -> list[Path]:
    """Return the FMUs that a path in crosscheck.toml names, with PLACE of all mechanisms; [] for one elsewhere."""
    if os.path.isabs(stated) or not (folder / stated).resolve().is_relative_to(folder.resolve()):
        return []
    found = folder.glob(stated.replace(PLACE, "*")) if PLACE in stated else [folder / stated]
    return sorted(f for f in found if f.is_file() and f.resolve().is_relative_to(folder.resolve()))


def _compute_digest(told: DoorSettings) -> str:
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def add_engine_limits(plan: Plan, engines: Mapping[str, Engine]) -> Plan:
    """Return the plan whose cases have, after their own limits, those that stand where engines are named."""
    more = [limit for engine in engines.values() for limit in engine.limits]
    return replace(plan, tasks=tuple(_add_limits(task, more) for task in plan.tasks)) if more else plan


def _add_limits(task: Task, more: Iterable[Any]) -> Task:
    known = tuple(limit for limit in more if limit.quantity in task.case.quantities)
    return replace(task, case=replace(task.case, limits=(*task.case.limits, *known)))


def compute_answer_digest(engine: Engine, folder: Path) -> str:
    """Return a digest of what an answer depends on beside the case: settings, programs, records in a mechanism's folder."""
    if engine.settings is None:
        source = Path(engine.path, *engine.module.partition(":")[0].split(".")).with_suffix(".py")
        return (
            ""
            if engine.name in ENGINES
            else compute_fingerprint(engine.module, source.read_bytes() if source.is_file() else b"")
        )
    files = (
        sorted(f for f in (folder / record.FOLDER / engine.name).rglob("*") if f.is_file())
        if engine.module == RECORD
        else []
    )
    home = Path(engine.settings.get("folder", ""))
    fmu = engine.settings.get("fmu", "").replace(PLACE, folder.name)
    files += [home / fmu] if fmu and (home / fmu).is_file() else []
    programs = compute_digests(_list_named(engine.settings.get("command", ()), home), home)
    return compute_fingerprint(
        dict(engine.settings), programs, [hashlib.sha256(f.read_bytes()).hexdigest() for f in files]
    )
