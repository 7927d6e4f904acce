"""Trim the measured record of the Quanser arm: python docs/studies/trim_quanser_record.py <clone of the repository>.

https://github.com/basta/quanser-2-dof-serial-flexible-link, commit 48ab0ce, file software/quanser_updated/lqr_full_10deg.mat
(MIT licence): every second sample of the six measured signals, with as many digits as their sensors give.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

OUT = Path(__file__).parents[2] / "models" / "quanser_2dsfl" / "record.csv"
MEASURED = 2  # column of the arrays: time, reference or command, measurement
EVERY = 2
# Encoders resolve 8.8e-4 and 1.8e-3 deg, the current 6.1e-4 A; the gauges' noise is filtered to some 1e-5 deg.
COLUMNS = (
    ("shoulder_deg", "data_th11", "%.5f"),
    ("elbow_deg", "data_th21", "%.5f"),
    ("gauge1_deg", "data_th12", "%.5f"),
    ("gauge2_deg", "data_th22", "%.5f"),
    ("current1_A", "data_Im1", "%.5f"),
    ("current2_A", "data_Im2", "%.5f"),
)


def main(repository: Path) -> None:
    """Write ``models/quanser_2dsfl/record.csv``; its time starts at 0 [s], at 82.174 s of the run."""
    data = loadmat(repository / "software" / "quanser_updated" / "lqr_full_10deg.mat", squeeze_me=True)
    time = data["data_th11"][::EVERY, 0]
    table = [time - time[0], *(data[array][::EVERY, MEASURED] for _, array, _ in COLUMNS)]
    header = ",".join(["time_s", *(name for name, _, _ in COLUMNS)])
    formats = ["%.3f", *(form for _, _, form in COLUMNS)]
    np.savetxt(OUT, np.column_stack(table), fmt=formats, delimiter=",", header=header, comments="")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
