"""What is no regular file is refused at once; XML and TOML that nest or repeat without end are refused in time that is linear."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.files.bounded_xml import DEEPEST, MOST_ELEMENTS, XmlBoundExceeded, parse_bounded
from flexinv.files.from_urdf import read_xml
from flexinv.files.lenient_xml import replace_invalid_xml
from flexinv.files.regular_files import NotRegularFile, read_regular
from flexinv.files.toml_tables import read_toml


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_socket(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # a socket's name has about a hundred characters at most
    try:
        with socket.socket(socket.AF_UNIX) as door:
            door.bind(path.name)
    finally:
        os.chdir(before)


IRREGULAR = {
    "a named pipe": (make_pipe, r"a named pipe \(FIFO\)"),
    "a socket": (make_socket, "a socket"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "a device"),
    "a folder": (lambda path: path.mkdir(), "a folder"),
    "a link to itself": (lambda path: path.symlink_to(path.name), "a symbolic link that leads to itself"),
    "a link to nothing": (lambda path: path.symlink_to("gone"), "a link to 'gone', which is not there"),
    "nothing": (lambda path: None, "no such file"),
}


@pytest.mark.parametrize("kind", IRREGULAR)
def test_what_is_no_regular_file_is_refused(kind: str, tmp_path: Path) -> None:
    make, words = IRREGULAR[kind]
    file = tmp_path / "arm.urdf"
    make(file)
    with pytest.raises(InputError, match=f"arm.urdf\n  given:    {words}\n"):
        flexinv.from_urdf(file)
    (tmp_path / "arm").mkdir()
    make(tmp_path / "arm" / "mechanism.toml")
    with pytest.raises(InputError, match=words):
        flexinv.load_mechanism(tmp_path / "arm")


def test_a_name_that_no_system_takes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a name that the system refuses") as caught:
        flexinv.from_urdf(tmp_path / ("a" * 9000))
    assert len(str(caught.value)) < 5000


def test_what_takes_the_place_of_a_file_is_looked_at_when_it_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at a name and its opening the file becomes a pipe: nobody waits for a writer."""
    os.mkfifo(tmp_path / "arm.urdf")
    monkeypatch.setattr("flexinv.files.regular_files.describe_kind", lambda path: "")
    with pytest.raises(NotRegularFile, match="a named pipe"):
        read_regular(tmp_path / "arm.urdf", 10)


def nested(depth: int) -> bytes:
    return b"<a>" * depth + b"</a>" * depth


def test_levels_and_elements_have_bounds(tmp_path: Path) -> None:
    assert len(list(parse_bounded(nested(DEEPEST)).iter())) == DEEPEST
    with pytest.raises(XmlBoundExceeded, match="levels"):
        parse_bounded(nested(DEEPEST + 1))
    assert len(parse_bounded(b"<a>" + b"<b/>" * (MOST_ELEMENTS - 1) + b"</a>")) == MOST_ELEMENTS - 1
    with pytest.raises(XmlBoundExceeded, match="elements and attributes"):
        parse_bounded(b"<a>" + b"<b/>" * MOST_ELEMENTS + b"</a>")
    with pytest.raises(XmlBoundExceeded, match="elements and attributes"):
        parse_bounded(b"<a " + b" ".join(b'a%d="1"' % k for k in range(MOST_ELEMENTS + 1)) + b"/>")
    (tmp_path / "arm.urdf").write_bytes(b"<robot>" + nested(100_000) + b"</robot>")
    words = r"given: +more than 500 levels of elements\n  expected: at most 500 levels\n  write: "
    with pytest.raises(InputError, match=words):
        read_xml(tmp_path / "arm.urdf")


@pytest.mark.parametrize("opening", [b"<!--", b"<![CDATA[", b"<a", b"<p:a "])
def test_what_opens_and_never_closes_is_searched_once(opening: bytes, tmp_path: Path) -> None:
    """Searching the rest for an end from every beginning would take an hour for these."""
    (tmp_path / "arm.urdf").write_bytes(b"<robot name='r'>" + opening * 1_000_000)
    with pytest.raises(InputError, match="does not parse"):
        read_xml(tmp_path / "arm.urdf")


def test_prefixes_without_end_are_not_put_right(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot>" + "".join(f"<p{k}:a/>" for k in range(100_000)) + "</robot>")
    with pytest.raises(InputError, match="does not parse"):
        read_xml(tmp_path / "arm.urdf")


def test_comments_and_sections_are_told_apart() -> None:
    """A comment within CDATA is text, and CDATA within a comment is comment."""
    text = b"<r><![CDATA[<!-- a -- b -->]]>\n<!-- <![CDATA[ c -- d -->\n<!-- e --></r>"
    mended, words = replace_invalid_xml(text)
    assert mended == text.replace(b"c -- d", b"c    d")
    assert words == ["line 2: -- within a comment"]


@pytest.mark.parametrize(
    "text", ["a." * 100_000 + "a = 1", "[" + "a." * 100_000 + "a]", "b = {" + "a." * 100_000 + "a = 1}"]
)
def test_keys_without_end_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "mechanism.toml").write_text(text)
    with pytest.raises(InputError, match="a key of more than 50 parts"):
        read_toml(tmp_path / "mechanism.toml")


def test_texts_with_many_dots_are_no_keys(tmp_path: Path) -> None:
    (tmp_path / "mechanism.toml").write_text(f'title = "{"a." * 100}"\nlist = [{"1.0, " * 100}]\n')
    assert len(read_toml(tmp_path / "mechanism.toml")["list"]) == 100


def test_a_mechanism_whose_urdf_is_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "arm.urdf")
    (tmp_path / "mechanism.toml").write_text('title = "arm"\nsource = "made here"\n[urdf]\npath = "arm.urdf"\n')
    with pytest.raises(InputError, match=r'path = "arm.urdf", a named pipe \(FIFO\)'):
        flexinv.load_mechanism(tmp_path)
