"""``corpus.toml`` beside the mechanisms: licences, recipes, authors of engines, and published values.

format = 1
licence = "BSD-3-Clause"                  # of mechanisms without a table of their own

[mechanisms.ur5]
licence = "BSD"
attribution = "ros-industrial/universal_robot"

[engines.simscape]
author = "MathWorks"

[[published]]
mechanism = "andrews_squeezer"
case = "spin_up"
series = "torque/beta"
at_s = 0.03
value = 0.033
unit = "N m"
source = "Test Set for IVP Solvers, problem andrews"
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from crosscheck.verdicts.plan import Task
from flexinv.files.toml_tables import Location, Table, check_table, make_key, make_optional_key, read_toml
from flexinv.files.values import Format, NotNegative, Number, Positive, Text

FILE = "corpus.toml"
NOT_STATED = "not stated: ask who made it"
FOREIGN = (
    "the mechanism is made from the file of a package whose licence corpus.toml does not state: install the package, then run "
    "the command below"
)


class MechanismNote(Table):
    """Licence of one mechanism: what its kit contains."""

    licence: Text = make_key("the licence of its data, a name", 'licence = "Apache-2.0"')
    attribution: Text = make_key("who has to be named, a text", 'attribution = "github.com/..."', default="")
    licence_files: list[Text] = make_key(
        "files of the folder of models that go with the kit", 'licence_files = ["licences/MIT.txt"]', default=[]
    )
    redistribute: bool = make_key("false: its data may not be passed on", "redistribute = false", default=True)
    recipe: Text = make_key("how to get it where it may not be passed on", 'recipe = "install ..."', default="")


class EngineNote(Table):
    """Author of an engine: a record, a program, or one of ours."""

    author: Text = make_key("who wrote it, a name", 'author = "MathWorks"')
    closed_form: bool = make_key("true: its series are a closed form", "closed_form = true", default=False)


class PublishedValue(Table):
    """A published number of a case: a series at a time, or its largest magnitude."""

    mechanism: Text = make_key("a folder of the models", 'mechanism = "andrews_squeezer"')
    case: Text = make_key("a case of it", 'case = "spin_up"')
    series: Text = make_key("name of a series", 'series = "torque/beta"')
    value: Number = make_key("the number [unit]", "value = 0.033")
    unit: Text = make_key("its unit", 'unit = "N m"')
    source: Text = make_key("where it was published", 'source = "..."')
    at_s: NotNegative | None = make_optional_key("time [s]; without it the largest magnitude is meant", "at_s = 0.03")
    digits: Positive | None = make_optional_key(
        "half of the last published digit [unit]; without it the digits of value", "digits = 5e-4"
    )
    note: Text = make_key("why it may lie beside the consensus", 'note = "computed with eight elements"', default="")


class CorpusTable(Table):
    """The whole file."""

    format: Format = make_key("format of this file: 1", "format = 1", default=1)
    licence: Text = make_key("of mechanisms without a table of their own", 'licence = "BSD-3-Clause"', default="")
    licence_files: list[Text] = make_key(
        "its texts, files of the folder of models", 'licence_files = ["licences/MIT.txt"]', default=[]
    )
    mechanisms: dict[str, MechanismNote] = make_key("tables [mechanisms.NAME]", "[mechanisms.ur5]", default={})
    engines: dict[str, EngineNote] = make_key("tables [engines.NAME]", "[engines.simscape]", default={})
    published: list[PublishedValue] = make_key("tables [[published]]", "[[published]]", default=[])

    def find_licence(self, task: Task) -> MechanismNote:
        """Return the licence of a mechanism: its own table, that of the file, or that nobody has stated one."""
        if (licence := self.mechanisms.get(task.folder.name)) is not None:
            return licence
        if is_from_package(task.folder):
            return MechanismNote(licence=NOT_STATED, redistribute=False, recipe=FOREIGN)
        return MechanismNote(licence=self.licence or NOT_STATED, licence_files=self.licence_files)


def is_from_package(folder: Path) -> bool:
    """Return True if a mechanism is made from a file of a package."""
    table: Any = read_toml(folder / "mechanism.toml").get("urdf")
    return isinstance(table, dict) and "package" in table


def read_notes(models: Path) -> CorpusTable:
    """Return the contents of ``corpus.toml`` in a folder of models, an empty table where there is none.  Raises InputError."""
    file = models / FILE
    if not file.is_file():
        return CorpusTable()
    plain = read_toml(file)
    for name, model in (("mechanisms", MechanismNote), ("engines", EngineNote)):
        for one, table in dict(plain.get(name, {})).items():
            check_table(model, table, Location(file, f"{name}.{one}"))  # its complaints name its own keys
    return check_table(CorpusTable, plain, Location(file))


def check_published(notes: CorpusTable, tasks: Iterable[Task], models: Path, whole: bool) -> None:
    """Raise InputError where a published value belongs to no case, or to no sample time [s] of its case.

    whole : the tasks are all of the folder; of a part of them a case that is not there may be another one
    """
    known = {(task.folder.name, task.case.name): task for task in tasks}
    for k, one in enumerate(notes.published):
        task = known.get((one.mechanism, one.case))
        if task is None:
            if whole and any(name == one.mechanism for name, _ in known):
                cases = sorted(case for name, case in known if name == one.mechanism)
                raise Location(models / FILE, f"published[{k}]").make_error(
                    "case", f'case = "{one.case}"', f"a case of {one.mechanism}", f'case = "{cases[0]}"'
                )
            continue
        if one.at_s is not None and abs(task.time - one.at_s).min() > 1e-6 * task.case.sample:
            near = float(task.time[abs(task.time - one.at_s).argmin()])
            raise Location(models / FILE, f"published[{k}]").make_error(
                "at_s",
                f"at_s = {one.at_s:g}",
                f"a sample of the case, every {task.case.sample:g} s",
                f"at_s = {near:.9g}",
            )
