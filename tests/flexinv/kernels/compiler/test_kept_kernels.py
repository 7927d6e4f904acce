"""A process that finds its kernels compiled loads their machine code, and nothing that only a compiler needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

COMPILER = ("numba.np.arraymath", "numba.np.linalg", "numba.typed.typeddict", "scipy.linalg", "scipy.ndimage")
PROGRAM = f"""
import sys, flexinv
from flexinv.kernels.compiler.code_cache import KERNELS
mechanism = flexinv.load_mechanism("models/double_pendulum")
case = flexinv.load_cases("models/double_pendulum", mechanism)["swing"]
flexinv.solve(mechanism, case.motion, case.step, error=True)
assert any(kernel.signatures for kernel in KERNELS)
print(*[name for name in {COMPILER!r} if name in sys.modules])
"""


@pytest.mark.slow
def test_kept_kernels_need_no_compiler(root: Path) -> None:
    """The first process keeps what it compiles; the program with a kernel of its own sees the compiler's tables."""

    def loaded(program: str) -> list[str]:
        done = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=True)
        return done.stdout.split()

    loaded(PROGRAM)
    assert loaded(PROGRAM) == []
    compiles = PROGRAM.replace("import sys, flexinv", "import sys, flexinv, numba; numba.njit(lambda x: x + 1)(1)")
    assert "numba.np.arraymath" in loaded(compiles)
