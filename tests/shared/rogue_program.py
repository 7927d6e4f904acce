"""The rogue engines as a program behind the command door: ``python rogue_program.py KIND MODEL CASE PIDS KIT OUT``.

What the rogue does in its process is done in this one; what it returns is written as an answer.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import rogue_engines as rogue

from crosscheck.measures.series_csv import write
from flexinv.errors import InputError
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism


def main(kind: str, model: str, name: str, pids: str, kit: str, out: str) -> None:
    """Do what the rogue does, and answer as it would."""
    mechanism = load_mechanism(model)
    case = load_cases(model, mechanism)[name]
    folder = Path(out)
    if (reason := rogue.unsupported(mechanism, case, kind)) is not None:
        (folder / "meta.json").write_text(json.dumps({"skipped": reason}))
        return
    if kind == "loud":
        for _ in range(300):
            os.write(1, b"iteration 1 residual 1e-3\n" * 1000)
    if kind == "flooding":
        with (folder / "series.csv").open("wb") as stream:
            while True:
                stream.write(b"0" * (1 << 20))
    record = rogue.run(mechanism, case, "fine" if kind == "loud" else kind, {"pids": pids})
    if record.series:
        write(folder / "series.csv", record.time, record.series.values())
    step = {"step": record.settings["step"]} if "step" in record.settings else {}
    (folder / "meta.json").write_text(json.dumps({"version": rogue.version(), **step}))
    try:
        said = rogue.certify(mechanism, case, kind).plain
    except InputError:
        return
    (folder / "certificate.json").write_text(
        json.dumps({key: value for key, value in said.items() if value not in (None, [], {}, ())})
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
