"""Whatever a name is, it is a word, a string and a comment of C that nothing gets out of."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import flexinv
from flexinv.errors import FlexinvError
from flexinv.export.export_c import export_c
from flexinv.export.export_ros import export_ros
from flexinv.export.link_library import Compiler
from flexinv.export.names import format_comment, format_markdown, format_string, make_word
from flexinv.export.written_files import write_files

HOSTILE = (
    '*/ #include "x"',
    "// \\\n",
    "??/",
    "int",
    "é\N{GREEK SMALL LETTER TAU}",
    '")); system("x',
    "<img src=x>|",
    "",
    "$(x) ${y}",
)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_stays_a_name(name: str) -> None:
    assert re.fullmatch(r"[A-Za-z0-9_]+", make_word(name))
    literal = format_string(name)
    assert "\n" not in literal
    assert not re.search(r'[?"]', literal[1:-1])
    read = ast.literal_eval(f"b{literal}")  # octal escapes are those of C
    assert read.decode() == name
    assert not re.search(r"[*/#\[\]\n\\?]", format_comment(name))
    assert not re.search(r"[<>|\n\[\]`()!]", format_markdown(name))


def test_words_of_different_names_may_be_one() -> None:
    """Which is why `make_words` refuses them."""
    assert make_word("a b") == make_word("a-b") == "a_b"
    assert make_word("a\N{LATIN SMALL LETTER E WITH ACUTE}") == "aue9"


def test_a_file_that_cannot_be_written_takes_the_others_with_it(tmp_path: Path) -> None:
    """A folder stands where a file should: the error names it, and what came before is gone."""
    (tmp_path / "second").mkdir()
    with pytest.raises(
        FlexinvError, match=r"export: .*second cannot be written \(Is a directory\); nothing of it is left"
    ):
        write_files(tmp_path, {"first/one": b"1", "second": b"2"})
    assert not (tmp_path / "first" / "one").exists()


def test_a_compiler_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a disk that is full in the midst of linking: the words of the compiler, what to do, and no half of a folder."""
    monkeypatch.setattr("flexinv.export.export_c.find_compiler", lambda target: Compiler(("false",), ("false",)))
    arm = flexinv.load_mechanism("models/rigid_3r")
    with pytest.raises(
        FlexinvError, match=r"(?s)export: false .* failed in .*nothing of the export is left: make room"
    ):
        export_c(arm, tmp_path / "new" / "library")
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(FlexinvError, match="nothing of the export is left"):
        export_ros(arm, tmp_path / "mine", overwrite=True)
    assert [path.name for path in (tmp_path / "mine").rglob("*")] == ["notes.txt"]
