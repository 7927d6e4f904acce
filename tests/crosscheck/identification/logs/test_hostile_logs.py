"""Logs that are no regular files, or swell, or are damaged: one error each, and none takes long."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import pytest

from crosscheck.identification.logs import log as logs
from crosscheck.identification.logs.log import read_log
from flexinv.errors import InputError

LINES = "time_s,a\n" + "".join(f"{k},1\n" for k in range(30))
PACKED = gzip.compress(("time_s,a\n" + "".join(f"{k},{k * k % 997}\n" for k in range(10**4))).encode())


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_sparse(path: Path) -> None:
    path.write_text("time_s,a\n")
    os.truncate(path, 2 << 30)


def make_torn(path: Path) -> None:
    path.write_bytes(gzip.compress(b"time_s,a\n" + b"0,1\n" * 10**5)[:-20])


def make_damaged(path: Path) -> None:
    path.write_bytes(PACKED[:200] + b"\xff" * 20 + PACKED[220:])


def make_other_letters(path: Path) -> None:
    path.write_bytes(b"time_s,a\n" + b"0,1\n" * 10**5 + b"\xff\xfe,\xe4\n")


BAD = {
    "a pipe": ("log.csv", make_pipe, r"it is a named pipe \(FIFO\)"),
    "a device": ("log.csv", make_device, "it is a device"),
    "gigabytes": ("log.csv", make_sparse, "2147483648 bytes, expected at most 1073741824"),
    "one line": ("log.csv", lambda path: path.write_text("x" * 3_000_000), "a line of more than 1048576 characters"),
    "one line, packed": ("log.csv.gz", lambda path: path.write_bytes(gzip.compress(b"x" * 10**8)), "a line of more than"),
    "no gzip": ("log.csv.gz", lambda path: path.write_bytes(b"time_s,a\n0,1\n"), "cannot be read"),
    "torn gzip": ("log.csv.gz", make_torn, "the packed file is damaged or ends too early"),
    "gzip with other bytes": ("log.csv.gz", make_damaged, "the packed file is damaged|cannot be read"),
    "gzip of a few bytes": ("log.csv.gz", lambda path: path.write_bytes(PACKED[:30]), "cannot be read"),
    "empty": ("log.csv", lambda path: path.write_bytes(b""), "its first line is empty, expected the names of columns"),
    "empty, packed": ("log.csv.gz", lambda path: path.write_bytes(gzip.compress(b"")), "its first line is empty"),
    "a cell more": ("log.csv", lambda path: path.write_text(LINES + "9,1,2\n" + LINES), "line 32 has 3 cells, expected 2"),
    "cells more": ("log.csv", lambda path: path.write_text("time_s,a\n" + "0,1,2\n" * 30), "more cells than the first"),
    "no time": ("log.csv", lambda path: path.write_text(LINES + ",1\n"), "sample 31 has no time"),
    "other letters": ("log.csv", make_other_letters, "no CSV that can be read"),
    "no Parquet": ("log.parquet", lambda path: path.write_bytes(b"PAR1" + bytes(100) + b"PAR1"), "Parquet"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_log_is_one_error(kind: str, tmp_path: Path) -> None:
    name, make, words = BAD[kind]
    make(tmp_path / name)
    with pytest.raises(InputError, match=words):
        read_log(tmp_path / name)


def test_a_packed_log_that_swells_is_read_in_part_and_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "MOST_SAMPLES", 1000)
    lines = "".join(f"{k},0\n" for k in range(1001))
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(f"time_s,a\n{lines}".encode()))
    with pytest.raises(InputError, match="more than 1000 samples; cut it"):
        read_log(tmp_path / "log.csv.gz")
