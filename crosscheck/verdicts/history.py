"""The history of nights: values of every comparison, versions, model, and the time that it took.

SQLite in one file by default; any database that SQLAlchemy knows by its URL for a team.  A night is added in one
transaction: it is there as a whole or not at all, and adding it twice is adding it once.

Other numbers are kept beside, such as ratios of benchmarks, with limits like those of torques:

    database = connect("sqlite:///reports/history.sqlite")
    add_metrics(database, [Metric("ur5 samples per second over Pinocchio", 1.3, "-", lower=1.0)], label="bench")

``add_metrics`` makes an entry of its own, stamped with time, machine and versions; the trend pages draw every metric
by name, and a value outside [lower, upper] is a deviation there.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import sqlalchemy as sql

from crosscheck.measures.limits import Verdict
from crosscheck.secrets import remove_password, remove_passwords
from crosscheck.verdicts import results as store
from crosscheck.verdicts.results import Results, StudyRow
from crosscheck.verdicts.signals import Key as SignalKey
from crosscheck.verdicts.signals import Signal

NO_SIGNALS: Mapping[SignalKey, Signal] = MappingProxyType({})
FORMAT = 1  # of the tables below; a change that an older version would misread raises it
PATIENCE = 30.0  # [s] to wait for somebody else's transaction: adding a night takes a second
_meta = sql.MetaData()


def _make_table(
    name: str, *columns: tuple[str, type[sql.types.TypeEngine[Any]] | sql.types.TypeEngine[Any]]
) -> sql.Table:
    """Return a table whose rows belong to a night."""
    night: sql.Column[int] = sql.Column("night", sql.ForeignKey("night.id"), nullable=False, index=True)
    return sql.Table(name, _meta, night, *(sql.Column(n, kind) for n, kind in columns))


# Names may be as long as a folder's; MySQL wants a length for what it indexes only.
Text = sql.Text
Float = sql.Double
NIGHT = sql.Table(
    "night",
    _meta,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("key", sql.String(64), nullable=False, unique=True),
    sql.Column("started", sql.String(40), nullable=False),
    sql.Column("label", sql.String(40), nullable=False),
    *(sql.Column(n, Text) for n in ("folder", "command", "message", "processor")),
    sql.Column("finished", sql.Boolean),
    sql.Column("exit_code", sql.Integer),
    sql.Column("elapsed", Float),
)
VERSION = _make_table("version", ("package", Text), ("version", Text))
MODEL = _make_table("model", ("mechanism", Text), ("case_name", Text), ("hash", Text))
TIMING = _make_table(
    *("timing", ("mechanism", Text), ("case_name", Text), ("engine", Text), ("version", Text), ("status", Text)),
    *(("wall_time", Float), ("elapsed", Float)),
)
NUMBERS = (
    *("maximum", "rms", "scale", "limit", "error_bar", "magnitude", "phase", "comprehensive", "blessed"),
    "fraction",
)
COMPARISON = _make_table(
    *("comparison", ("mechanism", Text), ("case_name", Text), ("engine", Text), ("reference", Text)),
    *(("quantity", Text), ("unit", Text), ("verdict", Text), ("message", Text)),
    *((n, Float) for n in NUMBERS),
)
SIGNAL = _make_table(
    *("signal", ("mechanism", Text), ("case_name", Text), ("engine", Text), ("series", Text), ("unit", Text)),
    *((n, Float) for n in ("size", "peak", "rms", "bar")),
)
CAUSE = _make_table(
    *("cause", ("mechanism", Text), ("case_name", Text), ("engine", Text), ("reference", Text)),
    *(("cause", Text), ("target", Text), ("words", Text)),
)
METRIC = _make_table(
    "metric", ("name", Text), ("value", Float), ("unit", Text), ("lower", Float), ("upper", Float), ("note", Text)
)


# Apart from the others: a history of before it had a number is one of format 1, and stays as it is until a night is added.
_FORMAT = sql.Table("history_format", sql.MetaData(), sql.Column("number", sql.Integer, primary_key=True))


# A row of a table by its columns: these are declared where the tables are made, and SQLAlchemy gives no types of them.
Row = Mapping[str, Any]


class HistoryError(RuntimeError):
    """The history cannot be read or written; the message says which and why.  Nothing was changed."""


class HistorySetupError(HistoryError):
    """No driver of the database is installed, or its address is none: trying again would not help."""


@dataclass(frozen=True)
class Metric:
    """A number to be kept over nights, value and limits in [unit]; None: no limit on that side."""

    name: str
    value: float
    unit: str
    lower: float | None = None
    upper: float | None = None
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """Return the verdict: "within" if the value keeps its limits, "unjudged" without limits."""
        if self.lower is None and self.upper is None:
            return "unjudged"
        above = self.lower is None or self.value >= self.lower
        return "within" if above and (self.upper is None or self.value <= self.upper) else "deviation"


@dataclass(frozen=True)
class Night:
    """One entry of the history: elapsed [s]; label: "" of an ordinary night, "latest-engines", "bench"."""

    id: int
    started: str
    label: str
    folder: str
    finished: bool
    exit_code: int
    elapsed: float


def open_database(url: str) -> sql.Engine:
    """Open a history, made on the first time.  Raises HistoryError, of it HistorySetupError for a driver or an address."""
    try:
        kind = sql.make_url(url).get_backend_name()
        waiting = {"timeout": PATIENCE} if kind == "sqlite" else {}
        # no pool: a connection that waits for the next use is open when Python ends, and one use in a night gains nothing by it
        database = sql.create_engine(url, connect_args=waiting, poolclass=sql.pool.NullPool)
        _check_format(database, url)
        _check_tables(database, url)
        _meta.create_all(database)
    except (ImportError, ValueError, sql.exc.NoSuchModuleError, sql.exc.ArgumentError) as error:
        words = f"cannot open the history {_format_address(url)}: {_describe_error(error, url)}"
        raise HistorySetupError(f"{words}{_describe_driver_advice(error, url)}") from None
    except (sql.exc.SQLAlchemyError, OSError) as error:
        raise HistoryError(f"cannot open the history {_format_address(url)}: {_describe_error(error, url)}") from None
    return database


# Drivers that SQLAlchemy takes where an address names none, and the address with one that has wheels.
DRIVERS = {
    "postgresql": ("psycopg[binary]", "postgresql+psycopg://"),
    "mysql": ("pymysql", "mysql+pymysql://"),
    "mariadb": ("pymysql", "mariadb+pymysql://"),
}


def _describe_driver_advice(error: Exception, url: str) -> str:
    """Return the advice for a driver that is not installed, "" for other mistakes."""
    kind = url.partition(":")[0].partition("+")[0]
    if not isinstance(error, ImportError) or kind not in DRIVERS:
        return ""
    package, address = DRIVERS[kind]
    return f"; write python -m pip install '{package}', and begin the address with {address}"


def check_writing(database: sql.Engine) -> None:
    """Write a night and take it back.  Raises HistoryError where the history cannot be written."""
    row = {"key": "a trial", "started": store.format_current_time(), "label": "trial"}
    try:
        with database.connect() as link:
            link.execute(sql.insert(NIGHT).values(**row))
            link.rollback()
    except sql.exc.SQLAlchemyError as error:
        words = _describe_error(error, database.url)
        raise HistoryError(f"cannot write the history {_format_address(database.url)}: {words}") from None


def _check_format(database: sql.Engine, url: str) -> None:
    """Raise HistoryError where the history is of a newer format; nothing is changed there."""
    if sql.inspect(database).has_table(_FORMAT.name):
        with database.connect() as link:
            number = max(link.scalars(sql.select(_FORMAT.c.number)), default=FORMAT)
        if number > FORMAT:
            raise HistoryError(
                f"cannot open the history {_format_address(url)}: it is of format {number}, and this crosscheck knows {FORMAT}; "
                "install a newer crosscheck, or write --history with another database"
            )


def _write_format(link: sql.Connection) -> None:
    """Write the number of the format beside the first night."""
    _FORMAT.create(link, checkfirst=True)
    if link.scalar(sql.select(_FORMAT.c.number)) is None:
        link.execute(_FORMAT.insert(), {"number": FORMAT})


def _check_tables(database: sql.Engine, url: str) -> None:
    """Raise HistoryError where a table of the database is called as one of ours and is another; nothing is changed there."""
    inside = sql.inspect(database)
    for table in _meta.sorted_tables:
        if inside.has_table(table.name):
            there = {column["name"] for column in inside.get_columns(table.name)}
            if lost := [column.name for column in table.columns if column.name not in there]:
                raise HistoryError(
                    f"cannot open the history {_format_address(url)}: its table {table.name} has no column {lost[0]}, so it is "
                    "somebody else's or of another version; write --history with another database"
                )


def add_night(
    database: sql.Engine,
    results: Results,
    folder: str = "",
    label: str = "",
    metrics: Iterable[Metric] = (),
    signals: Mapping[SignalKey, Signal] = NO_SIGNALS,
) -> int:
    """Add a night, all of it or nothing, and return its number; one that is there already keeps its number.

    signals : of every engine [units of the series]
    Raises HistoryError.
    """
    row = {
        **{"key": compute_night_key(results), "started": results.started, "label": label, "folder": folder},
        **{"command": results.command, "message": results.message, "finished": results.finished},
        **{"exit_code": results.exit_code, "elapsed": results.elapsed},
        "processor": results.machine.get("processor", ""),
    }
    kept: list[Row] = [
        {"mechanism": mechanism, "case_name": case, "engine": engine, "series": series, "unit": one.unit}
        | {"size": one.size, "peak": one.peak, "rms": one.rms, "bar": one.bar}
        for (mechanism, case, engine, series), one in signals.items()
    ]
    numbers: list[Row] = [dict(vars(m)) for m in metrics]
    return _add_rows(database, row, {**_collect_rows(results), METRIC: numbers, SIGNAL: kept})


def list_metrics(tables: Iterable[StudyRow]) -> list[Metric]:
    """Return the numbers that rows of tables carry for the history [unit of each]."""
    return [Metric(**row["metric"]) for table in tables for row in table.rows if row.get("metric")]


def add_metrics(database: sql.Engine, metrics: Sequence[Metric], label: str = "bench", elapsed: float = 0.0) -> int:
    """Add numbers that belong to no comparison, in [unit of each], as an entry of their own; elapsed [s].

    Raises HistoryError.
    """
    code = 1 if any(m.verdict == "deviation" for m in metrics) else 0
    stamp = Results(
        store.format_current_time(),
        label,
        elapsed,
        True,
        machine=store.describe_machine(),
        versions=store.list_versions(),
    )
    text = repr((stamp.started, label, [vars(m) for m in metrics], stamp.machine))
    row = {
        **{"key": hashlib.sha256(text.encode()).hexdigest()[:32], "started": stamp.started, "label": label},
        **{"folder": "", "command": label, "message": "", "finished": True, "exit_code": code, "elapsed": elapsed},
        "processor": stamp.machine.get("processor", ""),
    }
    return _add_rows(database, row, {**_collect_rows(stamp), METRIC: [dict(vars(m)) for m in metrics]})


def list_nights(database: sql.Engine, label: str | None = None) -> list[Night]:
    """Return the entries, the oldest first; label: only those.  Raises HistoryError."""
    question = sql.select(NIGHT).order_by(NIGHT.c.started, NIGHT.c.id)
    if label is not None:
        question = question.where(NIGHT.c.label == label)
    return [Night(*(row._mapping[name] for name in Night.__dataclass_fields__)) for row in ask(database, question)]


def read_rows(database: sql.Engine, table: sql.Table, night: int) -> list[Row]:
    """Return the rows of one night.  Raises HistoryError."""
    return [dict(row._mapping) for row in ask(database, sql.select(table).where(table.c.night == night))]


def has_night(database: sql.Engine, results: Results) -> bool:
    """Return True if a night is in the history.  Raises HistoryError."""
    return bool(
        ask(
            database,
            sql.select(NIGHT.c.id).where(NIGHT.c.key.in_((compute_night_key(results), _compute_older_key(results)))),
        )
    )


def ask(database: sql.Engine, question: sql.Select[Any]) -> list[Any]:
    """Return the rows that a question finds.  Raises HistoryError."""
    try:
        with database.connect() as connection:
            return list(connection.execute(question))
    except sql.exc.SQLAlchemyError as error:
        raise HistoryError(
            f"cannot read the history {_format_address(database.url)}: {_describe_error(error, database.url)}"
        ) from None


def compute_night_key(results: Results) -> str:
    """Return a key that no two runs share, of their time and duration, command, machine and number of rows.

    Times are known to the second, in which a short night may end and the next begin.
    """
    return _compute_digest(
        results.started, results.elapsed, results.command, sorted(results.machine.items()), len(results.runs)
    )


def _compute_older_key(results: Results) -> str:
    """The key of nights that were added before the duration was part of it."""
    return _compute_digest(results.started, results.command, sorted(results.machine.items()), len(results.runs))


def _compute_digest(*parts: Any) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def _collect_rows(results: Results) -> dict[sql.Table, list[Row]]:
    hashes = {(r.mechanism, r.case): r.model_hash for r in results.runs if r.model_hash}
    timings: list[Row] = [
        {"mechanism": r.mechanism, "case_name": r.case, "engine": r.engine, "version": r.version, "status": r.status}
        | {"wall_time": r.wall_time, "elapsed": r.elapsed}
        for r in results.runs
    ]
    words = ("mechanism", "engine", "reference", "quantity", "unit", "verdict", "message")
    comparisons: list[Row] = [
        {n: getattr(c, n) for n in words}
        | {n: _convert_to_finite(getattr(c, n)) for n in NUMBERS}
        | {"case_name": c.case}
        for c in results.comparisons
    ]
    return {
        VERSION: [{"package": p, "version": v} for p, v in results.versions.items()],
        MODEL: [{"mechanism": m, "case_name": c, "hash": h} for (m, c), h in hashes.items()],
        TIMING: timings,
        COMPARISON: comparisons,
        CAUSE: [
            {"mechanism": d.mechanism, "case_name": d.case, "engine": d.engine, "reference": d.reference}
            | {"cause": one["cause"], "target": one["target"], "words": one["words"]}
            for d in results.diagnoses
            for one in d.named
        ],
    }


def _add_rows(database: sql.Engine, night: Row, tables: Mapping[sql.Table, Sequence[Row]]) -> int:
    try:
        with database.begin() as connection:
            known = connection.execute(sql.select(NIGHT.c.id).where(NIGHT.c.key == night["key"])).scalar()
            if known is not None:
                return int(known)
            number = connection.execute(sql.insert(NIGHT).values(**night)).inserted_primary_key
            assert number is not None
            for table, rows in tables.items():
                if rows:
                    connection.execute(sql.insert(table), [{**row, "night": number[0]} for row in rows])
    except sql.exc.SQLAlchemyError as error:
        raise HistoryError(
            f"the night could not be added to the history {_format_address(database.url)}: "
            f"{_describe_error(error, database.url)}; it is as it was "
            "before, and the next night adds what is missing"
        ) from None
    # Somebody else may write the number at this moment; a history without it is one of format 1.
    with contextlib.suppress(sql.exc.SQLAlchemyError), database.begin() as connection:
        _write_format(connection)
    return int(number[0])


def _convert_to_finite(value: float | None) -> float | None:
    return value if value is not None and abs(value) < float("inf") else None


def _format_address(url: str | sql.URL) -> str:
    """Return an address without its password."""
    try:
        return remove_passwords(sql.make_url(url).render_as_string(hide_password=True))
    except (sql.exc.ArgumentError, ValueError):
        return "(not a URL)"


def _describe_error(error: BaseException, url: str | sql.URL) -> str:
    """Return the message of a database, without SQLAlchemy's hints, the statement and the password."""
    inner = getattr(error, "orig", None) or error
    try:
        password = sql.make_url(url).password
    except (sql.exc.ArgumentError, ValueError):
        return "expected such as sqlite:///reports/history.sqlite or postgresql://team@host/nights"
    return remove_password(str(inner).splitlines()[0], password) if str(inner) else type(inner).__name__
