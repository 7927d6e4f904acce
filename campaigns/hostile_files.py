"""Hostile files: what is no regular file, and XML, TOML and JSON that swell, nest or lie.  One function writes one file.

Each maker takes a folder and a generator of random numbers, writes a file (or what bears its name), and returns its path.
"""

from __future__ import annotations

import os
import random
import socket
from collections.abc import Callable
from pathlib import Path

Maker = Callable[[Path, random.Random], Path]
MAKERS: dict[str, Maker] = {}
HUGE = 8 << 30  # [bytes] of a file that takes no room on the disk

ROBOT = """<?xml version="1.0"?>
<robot name="two">
  <link name="base"/>
  <link name="upper">{shape}<inertial><origin xyz="0.1 0 0"/><mass value="{mass}"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{joint}" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="10" velocity="3"/></joint>
{more}</robot>
"""


def maker(function: Maker) -> Maker:
    """Enter a maker under its own name."""
    MAKERS[function.__name__] = function
    return function


def robot(shape: str = "", mass: str = "1.5", joint: str = "shoulder", more: str = "") -> str:
    """Return a small URDF."""
    return ROBOT.format(shape=shape, mass=mass, joint=joint, more=more)


def put(folder: Path, name: str, content: str | bytes) -> Path:
    """Write a file and return it."""
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


# What is no regular file.


@maker
def pipe(folder: Path, draw: random.Random) -> Path:
    """A named pipe that nobody writes into."""
    os.mkfifo(folder / "arm.urdf")
    return folder / "arm.urdf"


@maker
def pipe_mjcf(folder: Path, draw: random.Random) -> Path:
    """The same, by a name of MJCF."""
    os.mkfifo(folder / "arm.xml")
    return folder / "arm.xml"


@maker
def pipe_in_folder(folder: Path, draw: random.Random) -> Path:
    """A folder whose mechanism.toml is a named pipe."""
    (folder / "arm").mkdir()
    os.mkfifo(folder / "arm" / "mechanism.toml")
    return folder / "arm"


@maker
def pipe_as_kit(folder: Path, draw: random.Random) -> Path:
    """A folder whose case.json is a named pipe."""
    (folder / "arm").mkdir()
    os.mkfifo(folder / "arm" / "case.json")
    return folder / "arm"


@maker
def socket_file(folder: Path, draw: random.Random) -> Path:
    """A socket of Unix."""
    before = Path.cwd()
    os.chdir(folder)  # its name may have about a hundred characters
    try:
        with socket.socket(socket.AF_UNIX) as door:
            door.bind("arm.urdf")
    finally:
        os.chdir(before)
    return folder / "arm.urdf"


@maker
def folder_named_as_file(folder: Path, draw: random.Random) -> Path:
    """A folder with the name of a file."""
    (folder / "arm.urdf").mkdir()
    return folder / "arm.urdf"


@maker
def link_to_itself(folder: Path, draw: random.Random) -> Path:
    """A symbolic link to itself."""
    (folder / "arm.urdf").symlink_to("arm.urdf")
    return folder / "arm.urdf"


@maker
def link_circle(folder: Path, draw: random.Random) -> Path:
    """Two symbolic links to each other."""
    (folder / "arm.urdf").symlink_to("other.urdf")
    (folder / "other.urdf").symlink_to("arm.urdf")
    return folder / "arm.urdf"


@maker
def link_to_nothing(folder: Path, draw: random.Random) -> Path:
    """A symbolic link to a file that is not there."""
    (folder / "arm.urdf").symlink_to("gone.urdf")
    return folder / "arm.urdf"


@maker
def link_to_zeros(folder: Path, draw: random.Random) -> Path:
    """A symbolic link to /dev/zero."""
    (folder / "arm.urdf").symlink_to("/dev/zero")
    return folder / "arm.urdf"


@maker
def link_to_noise(folder: Path, draw: random.Random) -> Path:
    """A symbolic link to /dev/urandom, by a name of MJCF."""
    (folder / "arm.xml").symlink_to("/dev/urandom")
    return folder / "arm.xml"


@maker
def standard_input(folder: Path, draw: random.Random) -> Path:
    """The standard input."""
    return Path("/dev/stdin")


@maker
def terminal(folder: Path, draw: random.Random) -> Path:
    """The terminal."""
    return Path("/dev/tty")


@maker
def toml_of_zeros(folder: Path, draw: random.Random) -> Path:
    """A mechanism.toml that is /dev/zero."""
    (folder / "arm").mkdir()
    (folder / "arm" / "mechanism.toml").symlink_to("/dev/zero")
    return folder / "arm"


@maker
def sparse(folder: Path, draw: random.Random) -> Path:
    """A file of 8 GB that begins as a URDF does."""
    file = put(folder, "arm.urdf", robot())
    os.truncate(file, HUGE)
    return file


@maker
def sparse_mjcf(folder: Path, draw: random.Random) -> Path:
    """A file of 8 GB that begins as MJCF does."""
    file = put(folder, "arm.xml", "<mujoco>")
    os.truncate(file, HUGE)
    return file


@maker
def sparse_kit(folder: Path, draw: random.Random) -> Path:
    """A case.json of 8 GB."""
    file = put(folder, "case.json", "{}")
    os.truncate(file, HUGE)
    return file


@maker
def sparse_usd(folder: Path, draw: random.Random) -> Path:
    """A stage of 8 GB."""
    file = put(folder, "arm.usda", "#usda 1.0\n")
    os.truncate(file, HUGE)
    return file


@maker
def empty(folder: Path, draw: random.Random) -> Path:
    """No byte at all."""
    return put(folder, "arm.urdf", "")


@maker
def odd_name(folder: Path, draw: random.Random) -> Path:
    """A good file whose name has sequences for terminals, HTML and a line break."""
    return put(folder, "a\x1b[31m<script>\nrm.urdf", robot())


@maker
def long_name(folder: Path, draw: random.Random) -> Path:
    """A name that is longer than any file system takes."""
    return folder / ("a" * draw.randint(5000, 9000) + ".urdf")


# XML.


@maker
def laughs(folder: Path, draw: random.Random) -> Path:
    """Entities that double thirty times."""
    lines = ['<!ENTITY a0 "ha">', *(f'<!ENTITY a{k} "&a{k - 1};&a{k - 1};">' for k in range(1, 31))]
    return put(folder, "arm.urdf", f"<!DOCTYPE robot [{''.join(lines)}]>\n<robot name='&a30;'/>")


@maker
def laughs_mjcf(folder: Path, draw: random.Random) -> Path:
    """The same in MJCF."""
    lines = ['<!ENTITY a0 "ha">', *(f'<!ENTITY a{k} "&a{k - 1};&a{k - 1};">' for k in range(1, 31))]
    return put(folder, "arm.xml", f"<!DOCTYPE mujoco [{''.join(lines)}]>\n<mujoco model='&a30;'/>")


@maker
def one_long_entity(folder: Path, draw: random.Random) -> Path:
    """One entity of a megabyte, a thousand times."""
    return put(folder, "arm.urdf", f'<!DOCTYPE r [<!ENTITY a "{"x" * 10**6}">]><robot name="{"&a;" * 1000}"/>')


@maker
def foreign_entity(folder: Path, draw: random.Random) -> Path:
    """An entity that names a file of the machine."""
    return put(folder, "arm.urdf", '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>')


@maker
def foreign_doctype(folder: Path, draw: random.Random) -> Path:
    """A DOCTYPE that lies on a server."""
    return put(folder, "arm.urdf", '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/r.dtd">' + robot().split("\n", 1)[1])


def _nested(root: str, inner: str, depth: int) -> str:
    return f"<{root} name='r'>" + f"<{inner}>" * depth + f"</{inner}>" * depth + f"</{root}>"


@maker
def deep_urdf(folder: Path, draw: random.Random) -> Path:
    """Ten thousand levels."""
    return put(folder, "arm.urdf", _nested("robot", "link", 10_000))


@maker
def deeper_urdf(folder: Path, draw: random.Random) -> Path:
    """A million levels."""
    return put(folder, "arm.urdf", _nested("robot", "a", 1_000_000))


@maker
def deep_mjcf(folder: Path, draw: random.Random) -> Path:
    """Ten thousand bodies, one in the other."""
    depth = 10_000
    body = '<body pos="0 0 .1"><joint/><geom size=".01"/>'
    return put(folder, "arm.xml", f"<mujoco><worldbody>{body * depth}{'</body>' * depth}</worldbody></mujoco>")


@maker
def deeper_mjcf(folder: Path, draw: random.Random) -> Path:
    """A million elements that MuJoCo does not know, one in the other."""
    return put(folder, "arm.xml", "<mujoco>" + "<a>" * 10**6 + "</a>" * 10**6 + "</mujoco>")


@maker
def deep_sdf(folder: Path, draw: random.Random) -> Path:
    """Ten thousand models, one in the other."""
    depth = 10_000
    return put(folder, "arm.sdf", "<sdf version='1.10'>" + "<model>" * depth + "</model>" * depth + "</sdf>")


@maker
def many_attributes(folder: Path, draw: random.Random) -> Path:
    """An element with half a million attributes."""
    return put(folder, "arm.urdf", "<robot " + " ".join(f'a{k}="1"' for k in range(500_000)) + "/>")


@maker
def many_elements(folder: Path, draw: random.Random) -> Path:
    """Two million elements that nobody knows."""
    return put(folder, "arm.urdf", robot(more="<a/>" * 2_000_000))


@maker
def many_comments(folder: Path, draw: random.Random) -> Path:
    """Comments that begin and never end: each begins a search through the rest."""
    return put(folder, "arm.urdf", "<robot name='r'>" + "<!--" * 2_000_000)


@maker
def many_hyphens(folder: Path, draw: random.Random) -> Path:
    """One comment of nothing but hyphens."""
    return put(folder, "arm.urdf", "<robot name='r'><!--" + "-" * 8_000_000 + "--></robot>")


@maker
def many_openings(folder: Path, draw: random.Random) -> Path:
    """Tags that begin and never end."""
    return put(folder, "arm.urdf", "<robot name='r'>" + "<a" * 4_000_000)


@maker
def many_sections(folder: Path, draw: random.Random) -> Path:
    """CDATA that begins and never ends."""
    return put(folder, "arm.urdf", "<robot name='r'>" + "<![CDATA[" * 1_000_000)


@maker
def many_prefixes(folder: Path, draw: random.Random) -> Path:
    """A hundred thousand prefixes that nothing declares."""
    return put(folder, "arm.urdf", "<robot name='r'>" + "".join(f"<p{k}:a/>" for k in range(100_000)) + "</robot>")


@maker
def long_attribute(folder: Path, draw: random.Random) -> Path:
    """A name of 15 million characters."""
    return put(folder, "arm.urdf", robot(joint="j" * 15_000_000))


@maker
def torn(folder: Path, draw: random.Random) -> Path:
    """A file that ends somewhere."""
    text = robot()
    return put(folder, "arm.urdf", text[: draw.randint(60, len(text) - 20)])


@maker
def null_bytes(folder: Path, draw: random.Random) -> Path:
    """A good file with bytes of zero in it."""
    return put(folder, "arm.urdf", robot().replace("upper", "up\0per"))


@maker
def utf16(folder: Path, draw: random.Random) -> Path:
    """A good file in UTF-16."""
    return put(folder, "arm.urdf", robot().replace('version="1.0"', 'version="1.0" encoding="utf-16"').encode("utf-16"))


@maker
def utf16_unsaid(folder: Path, draw: random.Random) -> Path:
    """UTF-16 without its mark."""
    return put(folder, "arm.urdf", robot().encode("utf-16-le"))


@maker
def marked(folder: Path, draw: random.Random) -> Path:
    """A good file with the mark of UTF-8 before it."""
    return put(folder, "arm.urdf", robot().encode("utf-8-sig"))


@maker
def other_encoding(folder: Path, draw: random.Random) -> Path:
    """An encoding that is a compression of Python's."""
    name = draw.choice(("zlib_codec", "rot13", "idna", "unknown-8"))
    return put(folder, "arm.urdf", robot().replace('version="1.0"', f'version="1.0" encoding="{name}"'))


@maker
def escapes(folder: Path, draw: random.Random) -> Path:
    """Names with HTML, and with line breaks and tabs."""
    return put(folder, "arm.urdf", robot(joint="&lt;script&gt;alert(1)&lt;/script&gt;&#10;&#9;[31m"))


@maker
def odd_numbers(folder: Path, draw: random.Random) -> Path:
    """Masses that are no numbers for most readers."""
    return put(folder, "arm.urdf", robot(mass=draw.choice(("nan", "inf", "1e308", "-1e308", "1_0", "٣", "0x10"))))


@maker
def endless_number(folder: Path, draw: random.Random) -> Path:
    """A mass of three million digits."""
    return put(folder, "arm.urdf", robot(mass="1" * 3_000_000))


# TOML and JSON.


@maker
def deep_toml(folder: Path, draw: random.Random) -> Path:
    """Lists in lists, a hundred thousand times."""
    (folder / "arm").mkdir()
    put(folder / "arm", "mechanism.toml", "a = " + "[" * 100_000 + "]" * 100_000)
    return folder / "arm"


@maker
def dotted_toml(folder: Path, draw: random.Random) -> Path:
    """A key of a hundred thousand parts."""
    (folder / "arm").mkdir()
    put(folder / "arm", "mechanism.toml", "a." * 100_000 + "a = 1")
    return folder / "arm"


@maker
def digits_toml(folder: Path, draw: random.Random) -> Path:
    """A whole number of half a million digits."""
    (folder / "arm").mkdir()
    put(folder / "arm", "mechanism.toml", "format = " + "9" * 500_000)
    return folder / "arm"


@maker
def urdf_that_is_a_pipe(folder: Path, draw: random.Random) -> Path:
    """A mechanism whose URDF is a named pipe."""
    (folder / "arm").mkdir()
    os.mkfifo(folder / "arm" / "arm.urdf")
    put(folder / "arm", "mechanism.toml", 'title = "arm"\nsource = "made here"\n[urdf]\npath = "arm.urdf"\n')
    return folder / "arm"


@maker
def deep_kit(folder: Path, draw: random.Random) -> Path:
    """JSON in JSON, a million times."""
    return put(folder, "case.json", '{"format": ' + "[" * 10**6 + "]" * 10**6 + "}")


@maker
def long_kit(folder: Path, draw: random.Random) -> Path:
    """A list of ten million numbers where a table is expected."""
    return put(folder, "case.json", '{"format": [' + "1," * 10**7 + "1]}")


@maker
def torn_kit(folder: Path, draw: random.Random) -> Path:
    """JSON that ends somewhere."""
    return put(folder, "case.json", '{"format": "crosscheck-case/1", "mechanism": {"links": [{"na')
