"""Developers' tools beside the packages, in a checkout: `benchmarks` and `campaigns`, imported when a command needs them.

An installed package brings none of them.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from flexinv.errors import InputError

ROOT = Path(__file__).resolve().parents[1]


def open_checkout_module(module: str, command: str) -> Any:
    """Import a module such as ``benchmarks.parts`` that stands beside the packages, for a command such as ``crosscheck bench``.

    Raises InputError where the packages stand in no checkout.
    """
    folder = module.partition(".")[0]
    if not (ROOT / folder / "__init__.py").is_file():
        raise InputError(
            f"{command} needs a checkout of flexinv: its folder {folder}/ is no part of the installed package; "
            f"write git clone, then make report, and call {command} there"
        )
    if str(ROOT) not in sys.path:
        sys.path.append(str(ROOT))
    return importlib.import_module(module)
