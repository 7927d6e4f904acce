"""Installers: pip, and uv where it is there, as programs of their own with words for what they could not do.

    resolve    requirements -> pins: name, version and the hash of every file, before anything is installed
    install    pins -> an environment: these files, and no others

Wheels alone by default: nothing of a package runs while it is installed.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote, urlsplit

from crosscheck.bisect.surroundings import make_installer_environment
from crosscheck.run.processes import end_process_tree
from crosscheck.secrets import remove_passwords
from flexinv.errors import InputError

PATIENCE = 1800.0  # [s] that one call of an installer may take: a large wheel over a slow line
# Words of pip and uv by which a failure is told apart; each stands in their sources.
NETWORK_TROUBLE = re.compile(
    r"NewConnectionError|ConnectTimeoutError|ReadTimeoutError|Failed to establish a new connection|Name or service not known"
    r"|Temporary failure in name resolution|ProxyError|error sending request|dns error|Could not fetch URL|Connection refused"
)
SPACE_TROUBLE = re.compile(r"No space left on device|\[Errno 28\]|os error 28|Disk quota exceeded")
NO_WHEEL = re.compile(
    r"No matching distribution found|ResolutionImpossible|No solution found|no wheels|is not a supported wheel"
    r"|requires a different Python|not compatible|because of their hashes|Failed to build|metadata-generation-failed"
    r"|conflicting dependencies|Cannot install"
)
PIN = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>[^\s;\\]+)", re.M)


class InstallerError(InputError):
    """An installer could not do what every release needs: no network, no space, no pip.  The search stops; it can go on later."""


class CannotInstall(Exception):
    """A release cannot be installed here, others may: the words say why."""


@dataclass(frozen=True)
class Index:
    """Source of releases: addresses and folders that the user states; without any those that pip is configured for."""

    url: str = ""
    extra: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    offline: bool = False

    @property
    def options(self) -> list[str]:
        """The options of pip."""
        words = ["--no-index"] if self.offline else []
        words += ["--index-url", self.url] if self.url else []
        words += [word for url in self.extra for word in ("--extra-index-url", url)]
        return words + [word for place in self.links for word in ("--find-links", place)]

    @property
    def place(self) -> str:
        """The index in words, without passwords; "" where the user states none."""
        return remove_passwords(", ".join(filter(None, (self.url, *self.extra, *self.links))))


@dataclass(frozen=True)
class ProgramAnswer:
    """End of an installer's process: exit code and what it printed."""

    code: int
    out: str
    errors: str

    def describe(self, what: str) -> str:
        """Return the words of a failure: what was wanted, the kind of trouble, and the last line of the installer."""
        lines = [line.strip() for line in self.errors.splitlines() if line.strip()]
        told = [line for line in lines if line.startswith(("ERROR", "error", "×", "Caused by"))]
        said = remove_passwords((told or lines or ["it said nothing"])[-1])[:400]
        if SPACE_TROUBLE.search(self.errors):
            return f"{what}: no space is left on the disk ({said}); free some, or write a smaller --disk, and call it again"
        if NETWORK_TROUBLE.search(self.errors):
            return f"{what}: the index cannot be reached ({said}); what was found is kept: call it again later"
        return f"{what}: {said}"

    @property
    def is_troubled(self) -> bool:
        """True where the network or the disk failed."""
        return bool(SPACE_TROUBLE.search(self.errors) or NETWORK_TROUBLE.search(self.errors))

    @property
    def is_about_release(self) -> bool:
        """True where the failure is the release's own, and not that of the network or of the disk."""
        return self.code != 0 and not self.is_troubled and bool(NO_WHEEL.search(self.errors))


def run_pip(python: str, words: Sequence[str], index: Index) -> ProgramAnswer:
    """Run this environment's pip for a Python.  Raises InstallerError where there is no pip."""
    if importlib.util.find_spec("pip") is None:
        raise InstallerError("pip is not installed beside crosscheck: write python -m ensurepip")
    verb, *rest = words
    verbs = [verb, rest.pop(0)] if verb == "index" else [verb]
    other = ["--python", python] if python != sys.executable else []
    command = [sys.executable, "-m", "pip", *other, *verbs, *index.options, *rest]
    return run_program(command, make_installer_environment())


def run_program(command: Sequence[str], environment: dict[str, str]) -> ProgramAnswer:
    """Run a program in a process group of its own; what it starts ends with it.  Raises InstallerError after `PATIENCE`."""
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        out, errors = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise InstallerError(f"{Path(command[0]).name} took longer than {PATIENCE:.0f} s: call it again") from None
    finally:
        end_process_tree(process.pid)
        process.wait()
    return ProgramAnswer(process.returncode, out, errors)


@dataclass(frozen=True)
class Installer:
    """pip, or uv where it is used; sources : whether a release without a wheel is built (its code runs then)."""

    index: Index
    uv: str = ""
    sources: bool = False

    @property
    def name(self) -> str:
        """The program in one word."""
        return "uv" if self.uv else "pip"

    def build_environment(self, python: str, folder: Path) -> str:
        """Make an empty environment and return its Python.  Raises InstallerError."""
        if self.uv:
            command = [self.uv, "venv", "--quiet", "--no-config", "--python", python, str(folder)]
        else:
            command = [python, "-m", "venv", "--without-pip", str(folder)]
        answer = run_program(command, make_installer_environment())
        if answer.code:
            raise InstallerError(answer.describe(f"no environment of {python} could be made"))
        return str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))

    def resolve_pins(self, python: str, requirements: Sequence[str], constraints: Sequence[str]) -> str:
        """Return pins with hashes as the text of a requirements file.  Raises CannotInstall, InstallerError."""
        with TemporaryDirectory(prefix="crosscheck-") as place:
            limits = Path(place) / "constraints.txt"
            limits.write_text("".join(f"{line}\n" for line in constraints), encoding="utf-8")
            if self.uv:
                return self._resolve_by_uv(python, requirements, limits)
            return self._resolve_by_pip(python, requirements, limits)

    def fill_environment(self, python: str, pins: Path) -> None:
        """Install the files of the pins, and nothing else.  Raises CannotInstall, InstallerError."""
        if self.uv:
            command = [
                self.uv,
                "pip",
                "install",
                "--quiet",
                "--no-config",
                "--no-deps",
                "--require-hashes",
                *self._wheels,
            ]
            answer = self._run_uv([*command, "--python", python, "-r", str(pins)])
        else:
            words = ["install", "--no-deps", "--require-hashes", "--no-compile", *self._wheels, "-r", str(pins)]
            answer = run_pip(python, words, self.index)
        _check_answer(answer, "the pinned files could not be installed")

    @property
    def _wheels(self) -> list[str]:
        return [] if self.sources else ["--only-binary", ":all:"]

    def _resolve_by_pip(self, python: str, requirements: Sequence[str], limits: Path) -> str:
        options = ["--dry-run", "--ignore-installed", "--quiet", "--report", "-", "--constraint", str(limits)]
        answer = run_pip(python, ["install", *options, *self._wheels, *requirements], self.index)
        _check_answer(answer, f"{' '.join(requirements)} cannot be installed")
        try:
            items = json.loads(answer.out)["install"]
            return "".join(sorted(map(format_pin, items)))
        except (ValueError, LookupError, TypeError) as error:
            raise InstallerError(f"pip gave no report that can be read: {error}; write --installer uv") from error

    def _resolve_by_uv(self, python: str, requirements: Sequence[str], limits: Path) -> str:
        wanted = limits.with_name("wanted.in")
        wanted.write_text("".join(f"{line}\n" for line in requirements), encoding="utf-8")
        command = [
            self.uv,
            "pip",
            "compile",
            "--quiet",
            "--no-config",
            "--no-header",
            "--no-annotate",
            "--generate-hashes",
        ]
        command += [*self._wheels, "--constraint", str(limits), "--python", python, str(wanted)]
        answer = self._run_uv(command)
        _check_answer(answer, f"{' '.join(requirements)} cannot be installed")
        return answer.out

    def _run_uv(self, command: Sequence[str]) -> ProgramAnswer:
        """Run uv with the index of the user, else with what pip is configured for."""
        return run_program(command, make_installer_environment() | make_uv_settings(self.index))


def choose_installer(wanted: str, index: Index, sources: bool) -> Installer:
    """Return the installer by name: pip, uv, or auto: uv where it is there.  Raises InstallerError for uv that is not."""
    uv = shutil.which("uv", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if wanted == "uv" and uv is None:
        raise InstallerError("--installer uv: uv is not installed; write python -m pip install uv, or --installer pip")
    return Installer(index, uv or "" if wanted != "pip" else "", sources)


def format_pin(item: dict[str, Any]) -> str:
    """Return the line of a pin: name, version and the hash of its file.  Raises LookupError for a report of another form."""
    data = item["metadata"]
    info = item["download_info"]
    hashes = info.get("archive_info", {}).get("hashes", {})
    digest = hashes.get("sha256") or _compute_file_digest(info["url"])
    return f"{data['name']}=={data['version']} --hash=sha256:{digest}\n"


def _compute_file_digest(url: str) -> str:
    """Return the hash of a file of this machine.  Raises LookupError for an address elsewhere: an index states its hashes."""
    parts = urlsplit(url)
    if parts.scheme != "file":
        raise LookupError(f"{remove_passwords(url)} has no hash")
    return hashlib.sha256(Path(unquote(parts.path)).read_bytes()).hexdigest()


def read_pins(text: str) -> dict[str, str]:
    """Return the versions that pins state, by name."""
    return {match["name"].lower().replace("_", "-"): match["version"] for match in PIN.finditer(text)}


def make_uv_settings(index: Index) -> dict[str, str]:
    """Return the variables by which uv uses the user's index, else those that pip is configured for: uv does not read its files.

    Variables, since an address may hold a password, and a command line can be read by others.
    """
    if index.options:
        url = index.url
        extra = " ".join(index.extra)
        links = " ".join(index.links)
        certificate = ""
    else:
        settings = read_pip_settings()
        url, extra, links, certificate = (
            settings.get(key, "") for key in ("index-url", "extra-index-url", "find-links", "cert")
        )
    made = {
        "UV_DEFAULT_INDEX": url,
        "UV_INDEX": extra,
        "UV_FIND_LINKS": ",".join(links.split()),
        "SSL_CERT_FILE": certificate,
    }
    made |= {"UV_NO_INDEX": "1"} if index.offline else {}
    return {name: value for name, value in made.items() if value} | {"UV_INDEX_STRATEGY": "unsafe-best-match"}


def read_pip_settings() -> dict[str, str]:
    """Return the settings of pip by key; of a key that is stated twice that of the environment."""
    answer = run_program([sys.executable, "-m", "pip", "config", "list"], make_installer_environment())
    settings: dict[str, str] = {}
    for line in answer.out.splitlines():
        key, equals, value = line.partition("=")
        scope, _, name = key.partition(".")
        if equals and scope in ("global", "install", ":env:"):
            settings[name] = " ".join(value.strip("'\"").replace("\\n", " ").split())
    return settings


def _check_answer(answer: ProgramAnswer, what: str) -> None:
    """Raise CannotInstall for a failure of the release's own, InstallerError for any other."""
    if answer.code == 0:
        return
    words = answer.describe(what)
    if answer.is_about_release:
        raise CannotInstall(words)
    raise InstallerError(words)
