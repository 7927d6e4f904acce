"""The engine behind the command and the record door of ``hostile.py``: it answers well, and then does one hostile thing.

    python hostile_program.py KIND KIT OUT ANSWER

ANSWER is a folder with a good answer to the kit.  Only Python's own library is used.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

Table = list[list[str]]
SLEEPER = [sys.executable, "-c", "import time; time.sleep(3000)  # of hostile.py"]
TERMINAL = "\x1b]0;owned\x07\x1b[2J\x1b[31m"
HTML = "<script>alert(1)</script><img src=x onerror=alert(2)>"


def _each(change: Callable[[str], str], first: int = 1) -> Callable[[Table], Table]:
    """Return a change of every number, of the times as well where ``first`` is 0."""
    return lambda t: [t[0], *([*row[:first], *map(change, row[first:])] for row in t[1:])]


def _one(value: str) -> Callable[[Table], Table]:
    """Return a change of one number in the middle."""
    return lambda t: [
        [value if (k, j) == (len(t) // 2, 1) else cell for j, cell in enumerate(row)] for k, row in enumerate(t)
    ]


def _times(change: Callable[[int, float], float]) -> Callable[[Table], Table]:
    return lambda t: [t[0], *([repr(change(k, float(row[0]))), *row[1:]] for k, row in enumerate(t[1:]))]


def _barred(value: str) -> Callable[[Table], Table]:
    """Return error bars beside every column of efforts."""
    return lambda t: [
        [*row, *(cell.replace(" [", " error [") if k == 0 else value for cell in t[0][1:])] for k, row in enumerate(t)
    ]


TABLES: dict[str, Callable[[Table], Table]] = {
    "nan": _one("nan"),
    "all_nan": _each(lambda x: "nan"),
    "infinite": _one("-inf"),
    "huge": _one("1e308"),
    "all_huge": _each(lambda x: "-1e308"),
    "beyond": _one("1e999"),
    "tiny": _each(lambda x: "1e-320"),
    "zeros": _each(lambda x: "-0.0"),
    "long_number": _one("1" * 100_000),
    "hexadecimal": _one("0x1p3"),
    "underscores": _one("1_0.0"),
    "other_digits": _one("٣.٥"),
    "words": _one("n/a"),
    "blank": _one(""),
    "decimal_commas": lambda t: [[cell.replace(".", ",") if k else cell for cell in row] for k, row in enumerate(t)],
    "fewer_rows": lambda t: t[:-3],
    "more_rows": lambda t: [*t, t[-1], t[-1]],
    "one_row": lambda t: t[:2],
    "ragged": lambda t: [row[: len(row) - (k == 3)] for k, row in enumerate(t)],
    "no_rows": lambda t: t[:1],
    "nothing": lambda t: [],
    "negative_times": _times(lambda k, t: -t),
    "backward_times": _times(lambda k, t: t if k != 3 else 0.0),
    "nan_times": _times(lambda k, t: t if k != 3 else float("nan")),
    "huge_times": _times(lambda k, t: 1e308 * t),
    "milliseconds": _times(lambda k, t: 1e3 * t),
    "other_unit": lambda t: [[cell.replace("[N m]", "[kN m]") for cell in t[0]], *t[1:]],
    "no_unit": lambda t: [[cell.partition(" [")[0] for cell in t[0]], *t[1:]],
    "doubled_column": lambda t: [[*row, row[1]] for row in t],
    "lost_column": lambda t: [[row[0], *row[2:]] for row in t],
    "odd_column": lambda t: [[*row, f"torque/{HTML} [N m]" if k == 0 else "0"] for k, row in enumerate(t)],
    "escape_column": lambda t: [[*row, f"torque/{TERMINAL} [N m]" if k == 0 else "0"] for k, row in enumerate(t)],
    "many_columns": lambda t: [
        [*row, *(f"x{j} [-]" if k == 0 else "0" for j in range(20_000))] for k, row in enumerate(t)
    ],
    "long_name": lambda t: [[*row, f"torque/{'x' * 10**6} [N m]" if k == 0 else "0"] for k, row in enumerate(t)],
    "long_quote": lambda t: [*t[:3], ['"' + "x" * 10**7]],
    "negative_bars": _barred("-1"),
    "nan_bars": _barred("nan"),
    "huge_bars": _barred("1e308"),
}
TEXTS: dict[str, Callable[[str], bytes]] = {
    "marked": lambda s: s.encode("utf-8-sig"),
    "utf16": lambda s: s.encode("utf-16"),
    "returns": lambda s: s.replace("\n", "\r").encode(),
    "windows": lambda s: s.replace("\n", "\r\n").encode(),
    "null_bytes": lambda s: s.replace(",", "\0,", 3).encode(),
    "latin": lambda s: s.replace("torque", "törque").encode("latin-1"),
    "noise": lambda s: bytes((k * k * 31 + 7) % 256 for k in range(20_000)),
    "semicolons": lambda s: s.replace(",", ";").encode(),
    "no_last_line": lambda s: s[:-9].encode(),
}
METAS = {
    "torn_meta": '{"version": "1", "no',
    "list_meta": "[1, 2]",
    "deep_meta": "[" * 10**6,
    "nan_meta": '{"wall_time": NaN}',
    "late_meta": '{"wall_time": -1e308}',
    "html_meta": json.dumps({"version": HTML, "tool": HTML, "notes": HTML}),
    "escape_meta": json.dumps({"version": TERMINAL, "notes": TERMINAL}),
    "escape_skipped": json.dumps({"skipped": TERMINAL + HTML}),
    "long_meta": json.dumps({"version": "x" * 10**6}),
    "unknown_meta": '{"exec": "rm"}',
    "digits_meta": '{"wall_time": ' + "9" * 10_000 + "}",
}
CERTIFICATES = {
    "torn_certificate": '{"masses": {"a"',
    "huge_certificate": '{"masses": {"joint1": 1e308, "joint2": 1e308, "joint3": 1e308}}',
    "nan_certificate": '{"masses": {"joint1": NaN}}',
    "odd_certificate": '{"gravity": [[1e308, 1e308, 1e308]]}',
    "wide_certificate": '{"mass_matrix": [[[1]]]}',
}


def main(kind: str, kit: str, out: str, answer: str) -> None:
    """Answer, and do it."""
    folder = Path(out)
    if kind in BEFORE:
        BEFORE[kind](folder, Path(kit))
    shutil.copytree(answer, folder, dirs_exist_ok=True)
    file = folder / "series.csv"
    text = file.read_text(encoding="utf-8")
    if kind in TABLES:
        table = TABLES[kind](list(csv.reader(text.splitlines())))
        file.write_text("".join(",".join(row) + "\n" for row in table), encoding="utf-8")
    elif kind in TEXTS:
        file.write_bytes(TEXTS[kind](text))
    elif kind in METAS:
        (folder / "meta.json").write_text(METAS[kind], encoding="utf-8")
    elif kind in CERTIFICATES:
        (folder / "certificate.json").write_text(CERTIFICATES[kind], encoding="utf-8")
    elif kind in AFTER:
        AFTER[kind](folder, Path(kit))


def _exit(code: int) -> Callable[[Path, Path], None]:
    return lambda out, kit: os._exit(code)


def _die(number: int) -> Callable[[Path, Path], None]:
    return lambda out, kit: os.kill(os.getpid(), number)


def _sleep(out: Path, kit: Path) -> None:
    time.sleep(3000)


def _sleep_deaf(out: Path, kit: Path) -> None:
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    time.sleep(3000)


def _stop(out: Path, kit: Path) -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def _flood(out: Path, kit: Path) -> None:
    while True:
        os.write(1, b"y" * (1 << 20))


def _flood_answer(out: Path, kit: Path) -> None:
    with (out / "series.csv").open("wb") as stream:
        while True:
            stream.write(b"0" * (1 << 20))


def _sparse_answer(out: Path, kit: Path) -> None:
    os.truncate(out / "series.csv", 10 << 30)


def _close(out: Path, kit: Path) -> None:
    os.close(1)
    os.close(2)
    time.sleep(3000)


def _read_input(out: Path, kit: Path) -> None:
    assert sys.stdin.read() == ""


def _write_input(out: Path, kit: Path) -> None:
    try:
        os.write(0, b"yes\n")
    except OSError:
        sys.exit(3)


def _print_odd(out: Path, kit: Path) -> None:
    os.write(1, (TERMINAL + HTML + "\n").encode() + bytes(range(256)) + b"\n" + b"z" * 10**6)
    sys.exit(4)


def _nothing(out: Path, kit: Path) -> None:
    shutil.rmtree(out)
    os._exit(0)


def _leave_session(out: Path, kit: Path) -> None:
    subprocess.Popen(SLEEPER, start_new_session=True)


def _leave_many(out: Path, kit: Path) -> None:
    for k in range(20):
        subprocess.Popen(SLEEPER, start_new_session=bool(k % 2))


def _leave_twice_removed(out: Path, kit: Path) -> None:
    words = f"import subprocess; subprocess.Popen({SLEEPER!r}, start_new_session=True)"
    subprocess.Popen([sys.executable, "-c", words], start_new_session=True).wait()


def _leave_and_sleep(out: Path, kit: Path) -> None:
    _leave_twice_removed(out, kit)
    time.sleep(3000)


def _answer_later(out: Path, kit: Path) -> None:
    """Leave a process that spoils the answer again and again once this one has ended."""
    words = (
        f"import time\nwhile True:\n    open({str(out / 'series.csv')!r}, 'w').write('spoilt')\n    time.sleep(0.01)"
    )
    subprocess.Popen([sys.executable, "-c", words], start_new_session=True)


def _lose_table(out: Path, kit: Path) -> None:
    (out / "series.csv").unlink()


def _link(target: str) -> Callable[[Path, Path], None]:
    def make(out: Path, kit: Path) -> None:
        (out / "series.csv").unlink()
        (out / "series.csv").symlink_to(target)

    return make


def _pipe(out: Path, kit: Path) -> None:
    (out / "series.csv").unlink()
    os.mkfifo(out / "series.csv")


def _folder(out: Path, kit: Path) -> None:
    (out / "series.csv").unlink()
    (out / "series.csv").mkdir()


def _pipe_meta(out: Path, kit: Path) -> None:
    (out / "meta.json").unlink(missing_ok=True)
    os.mkfifo(out / "meta.json")


def _link_folder(out: Path, kit: Path) -> None:
    shutil.rmtree(out)
    out.symlink_to("/")


def _lose_work(out: Path, kit: Path) -> None:
    shutil.rmtree(out.parent.parent, ignore_errors=True)


def _lose_kit(out: Path, kit: Path) -> None:
    shutil.rmtree(kit)


def _many_files(out: Path, kit: Path) -> None:
    for k in range(5000):
        (out / f"f{k}").touch()


def _deep_folders(out: Path, kit: Path) -> None:
    os.chdir(out)
    for _ in range(1500):
        os.mkdir("d" * 100)
        os.chdir("d" * 100)


def _shut(out: Path, kit: Path) -> None:
    out.chmod(0)


def _kill_parent(out: Path, kit: Path) -> None:
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(3000)


def _kill_group(out: Path, kit: Path) -> None:
    os.killpg(os.getpgid(0), signal.SIGKILL)


BEFORE = {
    "exit_1": _exit(1), "exit_2": _exit(2), "exit_255": _exit(255), "nothing_at_all": _nothing, "print_odd": _print_odd,
    "terminated": _die(signal.SIGTERM), "killed": _die(signal.SIGKILL), "crashed": _die(signal.SIGSEGV),
    "aborted": _die(signal.SIGABRT), "broken_pipe": _die(signal.SIGPIPE), "interrupted": _die(signal.SIGINT),
    "sleep": _sleep, "sleep_deaf": _sleep_deaf, "stop": _stop, "flood": _flood, "close": _close,
    "kill_parent": _kill_parent, "kill_group": _kill_group, "write_input": _write_input,
}  # fmt: skip
AFTER = {
    "flood_answer": _flood_answer, "sparse_answer": _sparse_answer, "read_input": _read_input, "leave_session": _leave_session,
    "leave_many": _leave_many, "leave_twice_removed": _leave_twice_removed, "leave_and_sleep": _leave_and_sleep,
    "answer_later": _answer_later, "lose_table": _lose_table, "link_out": _link("/etc/passwd"), "link_zeros": _link("/dev/zero"),
    "link_circle": _link("series.csv"), "pipe": _pipe, "folder": _folder, "pipe_meta": _pipe_meta, "link_folder": _link_folder,
    "lose_work": _lose_work, "lose_kit": _lose_kit, "many_files": _many_files, "deep_folders": _deep_folders, "shut": _shut,
}  # fmt: skip

if __name__ == "__main__":
    main(*sys.argv[1:])
