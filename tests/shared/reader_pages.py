"""The pages that readers see, the blocks of code on them, and the folder in which a reader tries them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
GENERATED = ("_build", "mechanisms", "examples", "reference/generated")
SITE = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "docs").rglob("*.md")
    if not path.relative_to(ROOT / "docs").as_posix().startswith(GENERATED)
)
PAGES = ("README.md", "NOTATION.md", *SITE)


def blocks(text: str, language: str) -> list[str]:
    """Fenced blocks of one language, padded so that line numbers in tracebacks are the page's."""
    result = re.finditer(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)
    return ["\n" * (text[: block.start()].count("\n") + 1) + block.group(1) for block in result]


def with_blocks(language: str) -> list[str]:
    return [page for page in PAGES if blocks((ROOT / page).read_text(), language)]


def project(folder: Path) -> Path:
    """A folder with all models, as a reader's checkout has them, and with a robot of the reader's own as URDF and MJCF.

    The robot is models/rigid_3r, as its case kit and `crosscheck export` write it.
    """
    shutil.copytree(ROOT / "models", folder / "models")
    (folder / "robots").mkdir()
    for name in ("arm.urdf", "arm.xml", "robots/arm.urdf"):
        shutil.copy(ROOT / "tests" / "data" / Path(name).name, folder / name)
    return folder
