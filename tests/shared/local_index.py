"""Packages that a test makes: wheels of a few lines, a folder of them, a page of an index, and an installer without pip."""

from __future__ import annotations

import base64
import hashlib
import importlib.util
import os
import sys
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from crosscheck.bisect.installers import CannotInstall, Index

TAG = "py3-none-any"


def write_wheel(
    folder: Path, name: str, version: str, source: str, requires: Sequence[str] = (), tag: str = TAG, module: str = ""
) -> Path:
    """Write the wheel of a package that is one module, by default of its name, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    info = f"{name}-{version}.dist-info"
    needs = "".join(f"Requires-Dist: {one}\n" for one in requires)
    files = {
        f"{module or name}.py": source,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{needs}",
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: {tag}\n",
    }
    rows = [f"{path},sha256={_digest(text)},{len(text.encode())}\n" for path, text in files.items()]
    path = folder / f"{name}-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for member, text in files.items():
            archive.writestr(member, text)
        archive.writestr(f"{info}/RECORD", "".join([*rows, f"{info}/RECORD,,\n"]))
    return path


def write_real_wheel(folder: Path, name: str, version: str, module: str, before: str = "") -> Path:
    """Write the wheel of a release that is the module installed here, so that a test installs a real engine without a network.

    before : what the release does first, such as an error
    """
    site = str(Path(importlib.util.find_spec(module).origin).parents[1])  # type: ignore[union-attr,arg-type]
    source = f"import sys\n{before}\nsys.path.insert(0, {site!r})\ndel sys.modules[{module!r}]\nimport {module}\n"
    return write_wheel(folder, name, version, source, module=module)


def _digest(text: str) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()


def write_simple_index(folder: Path, wheels: Mapping[str, Sequence[Path]], yanked: Sequence[str] = ()) -> str:
    """Write a simple index of files by package and return its address; yanked : names of files that were taken back."""
    for name, files in wheels.items():
        lines = []
        for file in files:
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            taken = ' data-yanked="broken"' if file.name in yanked else ""
            lines.append(f'<a href="{file.as_uri()}#sha256={digest}"{taken}>{file.name}</a><br>\n')
        place = folder / "simple" / name
        place.mkdir(parents=True)
        (place / "index.html").write_text(f"<!DOCTYPE html><html><body>{''.join(lines)}</body></html>")
    return (folder / "simple").as_uri()


@dataclass
class UnzippingInstaller:
    """What takes the place of pip where a test needs many environments: wheels of a folder, unzipped beside a link to Python.

    refused : requirements that cannot be had, with the reason; asked : requirements, in the order in which they were asked for
    """

    wheels: Path
    refused: dict[str, str] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    index: Index = field(default_factory=Index)
    sources: bool = False
    name: str = "test"

    def build_environment(self, python: str, folder: Path) -> str:
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "python").symlink_to(os.path.realpath(python))
        (folder / "pyvenv.cfg").write_text(f"home = {Path(os.path.realpath(python)).parent}\n")
        return str(folder / "bin" / "python")

    def resolve_pins(self, python: str, requirements: Sequence[str], constraints: Sequence[str]) -> str:
        self.asked.append(requirements[0])
        wanted = {}
        held = dict(one.split("==") for one in constraints)
        for one in requirements:
            if one in self.refused:
                raise CannotInstall(self.refused[one])
            name, _, version = one.partition("==")
            wanted[name] = version or held.get(name) or self._newest(name)
            for needed in self._requires(name, wanted[name]):
                base, _, stated = needed.partition("==")
                wanted[base] = stated or held.get(base) or self._newest(base)
                if base in held and held[base] != wanted[base]:
                    raise CannotInstall(f"conflict about {base}")
        return "".join(f"{name}=={version} --hash=sha256:{name}\n" for name, version in sorted(wanted.items()))

    def fill_environment(self, python: str, pins: Path) -> None:
        short = f"python{sys.version_info[0]}.{sys.version_info[1]}"
        site = Path(python).parents[1] / "lib" / short / "site-packages"
        site.mkdir(parents=True)
        for line in pins.read_text().splitlines():
            name, version = line.split()[0].split("==")
            with zipfile.ZipFile(self.wheels / f"{name}-{version}-{TAG}.whl") as archive:
                archive.extractall(site)

    def _newest(self, name: str) -> str:
        return sorted(file.name.split("-")[1] for file in self.wheels.glob(f"{name}-*.whl"))[-1]

    def _requires(self, name: str, version: str) -> list[str]:
        with zipfile.ZipFile(self.wheels / f"{name}-{version}-{TAG}.whl") as archive:
            text = archive.read(f"{name}-{version}.dist-info/METADATA").decode()
        return [
            line.removeprefix("Requires-Dist: ") for line in text.splitlines() if line.startswith("Requires-Dist: ")
        ]
