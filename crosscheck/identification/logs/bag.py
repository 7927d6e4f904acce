"""Bags of ROS (rosbag2 folders, .mcap, .db3, rosbag1 .bag): every number that a message holds, over even times.

Columns are called by topic and field: ``/joint_states/elbow/position`` of a JointState, ``/imu/linear_acceleration.x`` of others.
Times are those of the message's header, else those at which it was received; topics have times of their own, and all are taken at
even times at the pace of the topic with the most messages (`even_times`).  Where a topic is silent for long it has no number.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.identification.logs.even_times import Signal, take_even_times
from flexinv.errors import InputError
from flexinv.typing import Array

SUFFIXES = (".mcap", ".db3", ".bag")
STATES = "sensor_msgs/msg/JointState"
PARTS = ("position", "velocity", "effort")
MOST = 16  # numbers of an array that become columns: an image is no log
NANO = 1e-9


def is_bag(path: Path) -> bool:
    """Return True if a path is that of a bag [-]: by its suffix, or a folder with metadata.yaml."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag_columns(path: Path, time: str) -> dict[str, Array]:
    """Return the columns of a bag (samples,) [units of its messages] with even times [s] under the name ``time``.

    Raises InputError: rosbags is not installed, a bag that cannot be read, no numbers, times that run backwards.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(f"{path.name}: bags need rosbags; write pip install flexinv[bags], or export CSV") from error
    topics: dict[str, list[tuple[float, dict[str, float]]]] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            for connection, stamp, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                row = dict(_list_message_numbers(connection.topic, connection.msgtype, message))
                topics.setdefault(connection.topic, []).append((_read_message_time(message, stamp), row))
    except Exception as error:  # rosbags raises whatever the damage of a file leads to
        raise InputError(f"{path.name}: no bag that can be read ({error}); record it anew, or export CSV") from error
    some = {topic: rows for topic, rows in topics.items() if len(rows) > 1 and any(row for _, row in rows)}
    signals = [_read_topic_signal(path, topic, rows) for topic, rows in some.items()]
    if not signals:
        raise InputError(
            f"{path.name}: no message holds a number; record {STATES}, expected angles and efforts of joints"
        )
    even, columns = take_even_times(signals)
    return {time: even - even[0]} | columns


def _read_message_time(message: Any, received: int) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = float(stamp.sec) + NANO * float(stamp.nanosec) if stamp is not None else 0.0
    return seconds or NANO * received


def _list_message_numbers(topic: str, kind: str, message: Any) -> Iterator[tuple[str, float]]:
    """Names and values of the numbers of a message [units of the message]."""
    if kind == STATES:
        for part in PARTS:
            for joint, value in zip(message.name, getattr(message, part), strict=False):
                yield f"{topic}/{joint}/{part}", float(value)
        return
    for field, value in _list_field_numbers(message):
        yield f"{topic}/{field}" if field else topic, value


def _list_field_numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Numbers of a message's fields; "data" of the standard messages has no name of its own."""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif isinstance(value, np.ndarray):
        if value.ndim == 1 and len(value) <= MOST and value.dtype.kind in "fiub":
            yield from ((f"{name}_{k + 1}", float(x)) for k, x in enumerate(value))
    elif hasattr(value, "__dataclass_fields__"):
        for field in value.__dataclass_fields__:
            if field not in ("header", "__msgtype__"):
                parts = (name, "" if field == "data" else field)
                yield from _list_field_numbers(getattr(value, field), ".".join(filter(None, parts)))


def _read_topic_signal(path: Path, topic: str, rows: list[tuple[float, dict[str, float]]]) -> Signal:
    """Times [s] and columns of a topic: those that all of its messages have."""
    at = np.array([seconds for seconds, _ in rows])
    if back := np.flatnonzero(np.diff(at) <= 0.0).tolist():
        raise InputError(
            f"{path.name}: topic {topic} has times that run backwards at {at[back[0] + 1]:.9g} s, expected a later time with "
            "each message; leave the topic out of the bag, or cut the bag there"
        )
    names = [name for name in rows[0][1] if all(name in row for _, row in rows)]
    return at, {name: np.array([row[name] for _, row in rows]) for name in names}
