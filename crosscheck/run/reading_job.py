"""A reader's job: a function is called for a file in the caller's folder, within its memory, and its answer is written."""

from __future__ import annotations

import importlib
import os
import pickle
import traceback
from pathlib import Path

from crosscheck.engines.job_files import ReadJobFile
from crosscheck.run.processes import apply_memory_limit
from flexinv.errors import InputError

GIVEN = ".given"  # suffix of the file with the arguments, beside that of the answer


def read(job: ReadJobFile) -> None:
    """Write what the function ``job["function"]`` of a module gives for a file.

    A refusal is an answer, too: ("refused", words); any other exception is ("failed", words).
    """
    out = Path(job["out"])
    function = getattr(importlib.import_module(job["module"]), job["function"])
    arguments = pickle.loads(out.with_suffix(GIVEN).read_bytes())
    os.chdir(job["place"])
    apply_memory_limit(int(job["memory"]))
    try:
        answer = pickle.dumps(("answered", function(*arguments)))
    except InputError as error:
        answer = pickle.dumps(("refused", str(error)))
    except Exception as error:
        traceback.print_exc()
        words = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        answer = pickle.dumps(("failed", words))
    out.write_bytes(answer)
