"""Variables that programs get from this process: those that they need, and none that may hold a secret of the caller."""

from __future__ import annotations

import os
from collections.abc import Iterable

from crosscheck.run.processes import ONE_THREAD

# What a program needs to run as the user's others do.
NEEDED = (
    "PATH", "HOME", "USER", "LOGNAME", "SHELL", "TERM", "TZ", "TMPDIR", "LANG", "LANGUAGE", "LD_LIBRARY_PATH", "DISPLAY",
    "XAUTHORITY", "SYSTEMROOT", "MUJOCO_GL", "PYOPENGL_PLATFORM", "CUDA_VISIBLE_DEVICES", "OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE",
)  # fmt: skip
LOCALE = "LC_"
# What installers need beside: where the index is, and how to reach it.  Scripts get none of it.
INSTALLERS = ("PIP_", "UV_")
NETWORK = (
    "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY", "SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE",
    "NETRC", "XDG_CONFIG_HOME", "XDG_CONFIG_DIRS", "XDG_CACHE_HOME",
)  # fmt: skip


def make_script_environment(passed: Iterable[str] = ()) -> dict[str, str]:
    """Return the variables of a script: those that are needed, and those that the user passes by name; one thread a library."""
    wanted = {*NEEDED, *passed}
    chosen = {name: value for name, value in os.environ.items() if name in wanted or name.startswith(LOCALE)}
    threads = {f"{library}_NUM_THREADS": "1" for library in ONE_THREAD}
    fixed = {"PYTHONHASHSEED": "0", "PYTHONNOUSERSITE": "1", "PYTHONDONTWRITEBYTECODE": "1", "MPLBACKEND": "Agg"}
    return threads | fixed | chosen


def make_installer_environment() -> dict[str, str]:
    """Return the variables of pip and uv: those of scripts, and what says where the index is."""
    more = {
        name: value
        for name, value in os.environ.items()
        if name.startswith(INSTALLERS) or name in NETWORK or name.upper() in NETWORK
    }
    quiet = {
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_NO_INPUT": "1",
        "PIP_PROGRESS_BAR": "off",
        "UV_NO_PROGRESS": "1",
    }
    return make_script_environment() | more | quiet
