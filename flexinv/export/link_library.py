"""Objects become libraries by a C compiler of the system, or by that of the wheel `ziglang`; without one, by the user's own."""

from __future__ import annotations

import importlib.util
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexinv.errors import FlexinvError
from flexinv.export.machine_code import NATIVE, TARGETS
from flexinv.export.names import C_COMPILERS, COMPILER_PACKAGE

# No contraction: the checks and the parameters have the same digits with every compiler.
C_OPTIONS = ("-std=c99", "-O2", "-fPIC", "-ffp-contract=off", "-Wall", "-Wextra")


@dataclass(frozen=True)
class Compiler:
    """Words that compile C for a target, and words that make an archive."""

    compile: tuple[str, ...]
    archive: tuple[str, ...]


def find_compiler(target: str) -> Compiler | None:
    """Return a compiler [-] for a target, None where there is none."""
    machine = TARGETS[target][0].partition("-")[0]
    archive = shutil.which("ar")
    found = next(filter(None, map(shutil.which, _list_names(target))), None)
    if found and archive:
        return Compiler((found,), (archive,))
    if importlib.util.find_spec(COMPILER_PACKAGE) is not None:
        zig = sys.executable, "-m", COMPILER_PACKAGE
        crossed = () if target == NATIVE else ("-target", f"{machine}-linux-gnu")
        return Compiler((*zig, "cc", *crossed), (*zig, "ar"))
    return None


def _list_names(target: str) -> tuple[str, ...]:
    """Names of compilers for a target, the usual one first."""
    machine = TARGETS[target][0].partition("-")[0]
    native = target == NATIVE or platform.machine().lower().replace("amd64", "x86_64") == machine
    return C_COMPILERS if native else (f"{machine}-linux-gnu-gcc",)


def list_link_commands(prefix: str, target: str, compiler: Compiler | None) -> list[list[str]]:
    """Return the commands, run in the folder of a library, that make it of its objects and its source [-]."""
    use = compiler or Compiler(_list_names(target)[:1], ("ar",))
    place = f"lib/{target}"
    machine_code = [f"{place}/{prefix}_{part}.o" for part in ("entries", "kernels")]
    checks = f"{place}/{prefix}.o"
    library = f"{place}/lib{prefix}.a"
    return [
        [*use.compile, *C_OPTIONS, "-Iinclude", "-c", f"src/{prefix}.c", "-o", checks],
        [*use.archive, "rcs", library, checks, *machine_code],
        [*use.compile, "-shared", checks, *machine_code, "-lm", "-o", f"{place}/lib{prefix}.so"],
        [*use.compile, *C_OPTIONS, "-Iinclude", "src/selftest.c", library, "-lm", "-o", f"{place}/selftest"],
    ]


def list_linked_files(prefix: str, target: str) -> list[str]:
    """Return the paths [-] in the folder of a library that the commands for a target make."""
    return [f"lib/{target}/{name}" for name in (f"{prefix}.o", f"lib{prefix}.a", f"lib{prefix}.so", "selftest")]


def run_commands(folder: Path, commands: Sequence[Sequence[str]]) -> None:
    """Run commands in a folder [-]; FlexinvError says which one failed, and what it said."""
    for words in commands:
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise FlexinvError(
                f"export: {shlex.join(words)} failed in {folder}:\n{done.stderr.strip()}\n"
                "nothing of the export is left: make room where the disk is full, or take another compiler"
            )
