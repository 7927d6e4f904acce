"""Torques of a motion in a file: `flexinv.write_torques` beside reading, the call in Python and writing; time and memory.

    python -m benchmarks.torque_files 10000000

writes a motion of so many samples of a UR5 (positions, rates, accelerations; 0.23 GB for a million), and measures in one process

    read     the file by pandas, in parts
    call     `flexinv.joint_torques`, part by part
    write    the efforts, by the same shortest texts as flexinv, and by ``DataFrame.to_csv``
    whole    `flexinv.write_torques`, which does all three, looks at every number and compares rates with positions

and in processes of their own the largest memory of `write_torques` for the whole motion and for a tenth of it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import flexinv
from flexinv.model.mechanism import Mechanism
from flexinv.sampled.torque_run import ROWS
from flexinv.typing import Array

ROBOT = Path(__file__).resolve().parent.parent / "models" / "ur5"
LINES = 2_000  # rows that become text at once
MEMORY = "import sys, resource, flexinv; flexinv.write_torques(*sys.argv[1:], overwrite=True); "
MEMORY += "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"


def sample_motion_parts(robot: Mechanism, samples: int) -> Iterator[tuple[int, Array]]:
    """Yield the first number of each part, and its times, q, qd, qdd (samples, 19) [s], [rad], [1/s]: sines of 1 to 4 rad/s."""
    random = np.random.default_rng(0)
    size = random.uniform(0.3, 1.0, robot.nv)
    pace = random.uniform(1.0, 4.0, robot.nv)
    for first in range(0, samples, ROWS):
        at = 1e-3 * np.arange(first, min(first + ROWS, samples))
        angle = pace * at[:, None]
        q = size * np.sin(angle)
        yield first, np.hstack([at[:, None], q, size * pace * np.cos(angle), -(pace**2) * q])


def write_motion(robot: Mechanism, samples: int, file: Path) -> None:
    """Write a motion with nine decimals [rad], [1/s]."""
    series = (("position", ""), ("rate", "/s"), ("acceleration", "/s^2"))
    names = [f"{word} {name} [rad{per}]" for word, per in series for name in robot.velocity_names]
    line = ",".join(["%.9f"] * (len(names) + 1)) + "\n"
    with file.open("w") as stream:
        stream.write(",".join(["time [s]", *names]) + "\n")
        for _, part in sample_motion_parts(robot, samples):
            for first in range(0, len(part), LINES):
                some = part[first : first + LINES]
                stream.write(line * len(some) % tuple(some.ravel().tolist()))


def compute_seconds(run: Callable[[], None]) -> float:
    """Return the processor time of a call [s], that of its threads included."""
    begin = time.process_time()
    run()
    return time.process_time() - begin


def sample_part_seconds(robot: Mechanism, file: Path, out: Path) -> dict[str, float]:
    """Return the processor time [s] of reading, of the call in Python, and of writing in two ways, each summed over the parts."""
    seconds = dict.fromkeys(("read", "call", "write", "write by to_csv"), 0.0)
    reader = pd.read_csv(file, chunksize=ROWS)
    labels = ["time [s]", *robot.velocity_names]
    line = ",".join(["%r"] * len(labels)) + "\n"
    with out.open("w") as stream:
        while True:
            begin = time.process_time()
            frame = next(reader, None)
            if frame is None:
                return seconds
            table = frame.to_numpy()
            seconds["read"] += time.process_time() - begin
            nv = robot.nv
            q, qd, qdd = (np.ascontiguousarray(table[:, 1 + k * nv : 1 + (k + 1) * nv]) for k in range(3))
            begin = time.process_time()
            torque = flexinv.joint_torques(robot, q, qd, qdd)
            seconds["call"] += time.process_time() - begin
            begin = time.process_time()
            rows = np.column_stack([table[:, 0], torque])
            for first in range(0, len(rows), LINES):
                some = rows[first : first + LINES]
                stream.write(line * len(some) % tuple(some.ravel().tolist()))
            seconds["write"] += time.process_time() - begin
            begin = time.process_time()
            pd.DataFrame(rows, columns=labels).to_csv(stream, index=False)
            seconds["write by to_csv"] += time.process_time() - begin


def sample_memory(file: Path, out: Path) -> float:
    """Return the largest memory of a process that writes the torques of a file [MB]."""
    words = [sys.executable, "-c", MEMORY, str(ROBOT), str(file), str(out)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1]) / 1024.0


def main(samples: int) -> None:
    """Measure and print a line for each figure [s], [MB]."""
    robot = flexinv.load_mechanism(ROBOT)
    out: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "motion.csv"
        tenth = Path(folder) / "tenth.csv"
        result = Path(folder) / "torques.csv"
        write_motion(robot, samples, whole)
        write_motion(robot, samples // 10, tenth)
        flexinv.write_torques(robot, tenth, result)  # kernels are compiled, or read
        seconds = sample_part_seconds(robot, whole, Path(folder) / "parts.csv")
        (Path(folder) / "parts.csv").unlink()
        own = compute_seconds(lambda: _write_whole(robot, whole, result))
        memory = [sample_memory(file, result) for file in (tenth, whole)]
    least = seconds["read"] + seconds["call"] + seconds["write"]
    plain = least - seconds["write"] + seconds["write by to_csv"]
    out += [f"{name:<16} {value:9.2f} s" for name, value in seconds.items()]
    out += [f"{'whole':<16} {own:9.2f} s", f"whole over read + call + write: {own / least:.3f}"]
    out += [f"whole over read + call + to_csv: {own / plain:.3f}"]
    out += [f"memory {memory[0]:.0f} MB for {samples // 10} samples, {memory[1]:.0f} MB for {samples}"]
    sys.stdout.write("\n".join(out) + "\n")


def _write_whole(robot: Mechanism, motion: Path, result: Path) -> None:
    flexinv.write_torques(robot, motion, result, overwrite=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
