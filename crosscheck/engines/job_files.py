"""Jobs of child processes as their files hold them, a form for each kind, and what a parent asks for before it names a file.

The file of a job is a request with ``out``, the path of the answer; `crosscheck.run.child` says what is written there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NotRequired, TypedDict

from crosscheck.engines import Door
from crosscheck.engines.base import Options as EngineOptions


class PreparedDoor(Door):
    """Place of what a prepared process imports; plain : it is no adapter."""

    plain: NotRequired[bool]


class CaseRequest(TypedDict):
    """A case for an engine: folder of the mechanism, name of the case, options; afresh : in a process that is not forked."""

    mechanism: str
    case: str
    options: EngineOptions
    afresh: NotRequired[bool]


class CaseJobFile(Door, CaseRequest):
    """A run of one engine at one case."""

    kind: Literal["run"]
    engine: str
    out: str


class DescribeRequest(Door):
    """The question for version and abilities of an engine."""

    kind: Literal["describe"]
    engine: str


class DescribeJobFile(DescribeRequest):
    """The question for version and abilities, with the file of the answer."""

    out: str


class AbilitiesJobFile(Door):
    """The question which cases an adapter can do; cases : folder of the mechanism and name of the engine."""

    kind: Literal["abilities"]
    engine: str
    cases: list[tuple[str, str]]
    out: str


class AdapterDescription(TypedDict):
    """Answer to "describe", and the first line of the answer to "abilities"."""

    version: str
    abilities: str


class RefusalLine(TypedDict):
    """A further line of the answer to "abilities": why an engine cannot do a case, None where it can."""

    reason: str | None


class StudyRequest(TypedDict):
    """A function of a module, which may lie in a folder that is not installed, and what it is called with (JSON values)."""

    kind: Literal["study"]
    module: str
    function: str
    path: NotRequired[str]
    options: Mapping[str, Any]


class StudyJobFile(StudyRequest):
    """A function to be called, with the file of the answer."""

    out: str


class ExportRequest(Door):
    """The question for what an engine is given; folder : for its files, expected : stem of a record with the efforts."""

    kind: Literal["export"]
    engine: str
    mechanism: str
    case: str
    folder: str
    expected: str


class ExportJobFile(ExportRequest):
    """The question for what an engine is given, with the file of the answer."""

    out: str


class ExportAnswer(TypedDict):
    """Answer to "export": why there is none, ""."""

    problem: str


class ReadJobFile(TypedDict):
    """A function of a module that reads a file; place : the caller's folder, memory : [bytes] as text."""

    kind: Literal["read"]
    module: str
    function: str
    place: str
    memory: str
    out: str
