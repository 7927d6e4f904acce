"""Changes from one night to another as a report says them, key by key of ``results.json``."""

from __future__ import annotations

from typing import TypedDict


class VersionChange(TypedDict):
    """A package and its versions, "–" where it was not there."""

    package: str
    before: str
    after: str


class ValueChange(TypedDict):
    """A comparison with another value or another verdict; before, after : over the range [-], None where there is none."""

    what: str
    mechanism: str
    case: str
    before: float | None
    after: float | None
    before_verdict: str
    after_verdict: str
    message: str
    before_message: str


class SignalChange(TypedDict):
    """A value of an engine that moved; before, after [unit]; share, bar : of the size of the signal [-]."""

    what: str
    unit: str
    before: float
    after: float
    share: float
    bar: float


class CauseChange(TypedDict):
    """A cause that "appeared" or "vanished", where, and in words."""

    what: str
    name: str
    words: str


class SlowerRun(TypedDict):
    """A run that takes longer; before, after [s]."""

    run: str
    before: float
    after: float


class NightChanges(TypedDict, total=False):
    """Everything that changed since a night; empty where there is none, and without what older reports do not have."""

    night: str
    started: str
    versions: list[VersionChange]
    models: list[str]
    values: list[ValueChange]
    signals: list[SignalChange]
    appeared: list[str]
    vanished: list[str]
    causes: list[CauseChange]
    slower: list[SlowerRun]
