"""Bags of ROS: JointState and other messages become columns over even times; what cannot be read is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crosscheck.identification.logs.log import read_columns, read_log
from flexinv.errors import InputError

RATE = 100.0  # [Hz]


def bag(folder: Path, storage: str = "MCAP", silent: float = 0.0, back: bool = False) -> Path:
    """Write a bag of two joints at 100 Hz and a temperature at 20 Hz, silent for some seconds [s]; return its folder."""
    rosbags = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed: pip install flexinv[bags]")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds: Any = store.types
    stamp, header = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]

    def head(seconds: float) -> Any:
        whole = int(seconds)
        return header(stamp=stamp(sec=whole, nanosec=round(1e9 * (seconds - whole))), frame_id="")

    def send(writer: Any, connection: Any, at: float, message: Any) -> None:
        writer.write(connection, int(1e9 * at), store.serialize_cdr(message, connection.msgtype))

    with rosbags.Writer(folder, version=9, storage_plugin=getattr(rosbags.StoragePlugin, storage)) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        heat = writer.add_connection("/heat", "std_msgs/msg/Float64", typestore=store)
        words = writer.add_connection("/words", "std_msgs/msg/String", typestore=store)
        send(writer, words, 999.0, kinds["std_msgs/msg/String"](data="hello"))
        for k in range(300):
            seconds = 1000.0 + k / RATE
            q = np.array([np.sin(k / RATE), np.cos(k / RATE)])
            empty = np.zeros(0)
            state = kinds["sensor_msgs/msg/JointState"](head(seconds), ["elbow", "shoulder"], q, empty, 2.0 * q)
            if not 1.0 <= k / RATE < 1.0 + silent:
                send(writer, states, seconds + 0.003, state)
            if back and k == 100:
                send(writer, states, seconds + 0.004, state)
            if k % 5 == 0:
                send(writer, heat, seconds, kinds["std_msgs/msg/Float64"](data=20.0 + k / RATE))
    return folder


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_messages_become_columns_over_even_times(storage: str, tmp_path: Path) -> None:
    """Stamps are those of the headers; what comes at another pace is taken linearly between its messages."""
    folder = bag(tmp_path / "run", storage)
    files = [f for f in folder.iterdir() if f.suffix in (".mcap", ".db3")]
    for source in (folder, *files):
        log = read_log(source)
        assert set(log.columns) == {
            *(f"/joint_states/{j}/{k}" for j in ("elbow", "shoulder") for k in ("position", "effort")),
            "/heat",
        }
        assert log.time[0] == 0.0
        assert log.spacing == pytest.approx(1.0 / RATE, rel=1e-6)  # stamps hold nanoseconds
        assert np.allclose(log.read_column("/joint_states/elbow/position"), np.sin(log.time), atol=1e-6)
        assert np.allclose(log.read_column("/joint_states/shoulder/effort"), 2.0 * np.cos(log.time), atol=1e-6)
        assert np.allclose(log.read_column("/heat"), 20.0 + np.minimum(log.time, 2.95), atol=1e-6)
    assert "/heat" in read_columns(folder)


def test_what_lies_in_a_gap_is_not_made_up(tmp_path: Path) -> None:
    log = read_log(bag(tmp_path / "run", silent=0.5))
    with pytest.raises(InputError, match=r"position' has no number at 1 s .*cut the log there"):
        log.read_column("/joint_states/elbow/position")
    assert np.isfinite(log.read_column("/heat")).all()


def test_times_that_run_backwards_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"topic /joint_states has times that run backwards at 1001 s"):
        read_log(bag(tmp_path / "run", back=True))


def test_a_damaged_bag_is_one_error(tmp_path: Path) -> None:
    """Without rosbags it says what to install; with it, that the file cannot be read."""
    (tmp_path / "run.mcap").write_bytes(b"no bag")
    with pytest.raises(InputError, match=r"run\.mcap: (no bag that can be read|bags need rosbags)"):
        read_log(tmp_path / "run.mcap")
    with pytest.raises(InputError, match=r"lost\.mcap: there is no such file.*bag of ROS"):
        read_log(tmp_path / "lost.mcap")
