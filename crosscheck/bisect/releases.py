"""Releases of a package, as the index of this machine has them for a Python, and ranges of them.

pip is the client: it knows the user's indexes, proxies, certificates and credentials.  Nothing here opens a connection.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from crosscheck.bisect.installers import Index, InstallerError, run_pip
from crosscheck.bisect.pythons import Python
from flexinv.errors import InputError
from flexinv.validation import find_nearest_word

AVAILABLE = re.compile(r"^\s*Available versions: (?P<versions>.*)$", re.M)
# What pip says of a requirement that no release fulfils: all that it could have taken.  Newer pips have a line of its own for
# releases that were taken back, older ones list them with the others.
OFFERED = re.compile(r"\(from versions: (?P<versions>.*)\)$", re.M)
YANKED = re.compile(r"Ignored the following yanked versions: (?P<versions>.*)$", re.M)
NO_RELEASE = "0.dev0+none"  # no package has it
NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?")
SHOWN_RELEASES = 8  # in a message, from either end


@dataclass(frozen=True)
class Release:
    """A release of a package and the Python that can take it; python : None where no wheel is there for any."""

    version: Version
    python: Python | None

    def __str__(self) -> str:
        """Return the version as text."""
        return str(self.version)


@dataclass(frozen=True)
class ReleaseQuery:
    """Releases that count: pre-releases, yanked ones, those that have only sources."""

    pre: bool = False
    yanked: bool = False
    sources: bool = False


def list_releases(package: str, pythons: Sequence[Python], index: Index, query: ReleaseQuery) -> list[Release]:
    """Return the releases of a package in order, each with the first of the Pythons that it has a wheel for.

    Raises InputError for a name that is none, or one that the index does not have.
    """
    if not NAME.fullmatch(package):
        raise InputError(f"{package!r} is no name of a package; write one such as mujoco")
    known: dict[Version, Python | None] = {}
    for python in pythons:
        listed = _list_versions(package, python, index, query)
        offered = _list_offered(package, python, index, query) if listed or query.yanked else set()
        for version in listed | offered if query.yanked else listed:
            known[version] = known.get(version) or (python if version in offered else None)
    if not known:
        raise InputError(_describe_unknown(package, pythons, index))
    return [Release(version, known[version]) for version in sorted(known)]


def _list_versions(package: str, python: Python, index: Index, query: ReleaseQuery) -> set[Version]:
    """Return the versions that the index has for a Python, without those that were taken back."""
    answer = run_pip(python.executable, ["index", "versions", *(["--pre"] if query.pre else []), package], index)
    if answer.code == 0:
        return parse_versions(AVAILABLE, answer.out)
    if "No matching distribution" in answer.errors and not answer.is_troubled:
        return set()
    raise InstallerError(answer.describe(f"the releases of {package} could not be listed"))


def _list_offered(package: str, python: Python, index: Index, query: ReleaseQuery) -> set[Version]:
    """Return the versions that can be installed for a Python, those that were taken back with them."""
    wheels = [] if query.sources else ["--only-binary", ":all:"]
    words = ["install", "--dry-run", "--no-deps", *wheels, f"{package}==={NO_RELEASE}"]
    printed = run_pip(python.executable, words, index).errors
    versions = parse_versions(OFFERED, printed) | parse_versions(YANKED, printed)
    return versions if query.pre else {version for version in versions if not version.is_prerelease}


def parse_versions(pattern: re.Pattern[str], printed: str) -> set[Version]:
    """Return the versions of the line that fits; what is no version by the rules of today is left out."""
    match = pattern.search(printed)
    versions = set()
    for word in match["versions"].split(",") if match else ():
        try:
            versions.add(Version(word.strip()))
        except InvalidVersion:
            continue
    return versions


def _describe_unknown(package: str, pythons: Sequence[Python], index: Index) -> str:
    """Return the message for a package without any release."""
    names = " or ".join(python.version for python in pythons)
    where = f" ({index.place})" if index.place else ""
    return (
        f"the index{where} has no release of {package} for Python {names}: check the name {canonicalize_name(package)!r}, "
        "or write another --python or --index-url"
    )


def choose_range(releases: Sequence[Release], range_: str, package: str) -> list[Release]:
    """Return the releases of a range such as 3.3.7..4.0.0, both ends with it; an end left out is the oldest, the newest.

    Raises InputError for words that are no range, an end that the index does not have, and a range of fewer than two releases.
    """
    low, dots, high = range_.partition("..")
    if not dots:
        raise InputError(f"{range_!r} is no range of releases; write OLD..NEW, such as {_format_range(releases)}")
    first = _find_end(releases, low, package) if low else releases[0].version
    last = _find_end(releases, high, package) if high else releases[-1].version
    if first > last:
        raise InputError(f"the range {range_} ends before it begins: write {high}..{low}, the older release first")
    chosen = [release for release in releases if first <= release.version <= last]
    if len(chosen) < 2:
        raise InputError(f"the range {range_} of {package} holds one release: nothing lies between; write a wider one")
    return chosen


def _find_end(releases: Sequence[Release], text: str, package: str) -> Version:
    """Return the version of an end of a range.  Raises InputError where the index does not list it."""
    try:
        version = Version(text)
    except InvalidVersion:
        raise InputError(f"{text!r} is no release of {package}; write one such as {releases[-1]}") from None
    if version not in {release.version for release in releases}:
        words = [str(release) for release in releases]
        near = find_nearest_word(text, words)
        hint = f"; do you mean {near}?" if near else ""
        more = "" if not version.is_prerelease else "; pre-releases count with --pre"
        raise InputError(
            f"the index has no release {text} of {package} for this Python{more}; it has {describe_list(words)}{hint}"
        )
    return version


def describe_list(words: Sequence[str]) -> str:
    """Return a list in words, without its middle where it is long."""
    if len(words) <= 2 * SHOWN_RELEASES:
        return ", ".join(words)
    left = len(words) - 2 * SHOWN_RELEASES
    return ", ".join([*words[:SHOWN_RELEASES], f"({left} more)", *words[-SHOWN_RELEASES:]])


def _format_range(releases: Iterable[Release]) -> str:
    """Return the widest range, as an example."""
    versions = [str(release) for release in releases]
    return f"{versions[0]}..{versions[-1]}"
