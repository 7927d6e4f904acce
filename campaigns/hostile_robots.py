"""Hostile robots: chains without end, includes of themselves, numbers of parts that no memory holds, archives that swell."""

from __future__ import annotations

import gzip
import os
import random
import zipfile
from pathlib import Path

from hostile_files import HUGE, maker, put, robot

LINK = (
    '<link name="l{k}"><inertial><origin xyz="0 0 0.05"/><mass value="1"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="j{k}" type="{kind}"><parent link="l{parent}"/><child link="l{k}"/><origin xyz="0 0 0.1"/>'
    '<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="10" velocity="3"/></joint>'
)
MANY = 2000


def _chain(count: int, kind: str, star: bool = False) -> str:
    """Return a URDF of a chain, or of a star."""
    parts = ['<robot name="chain">', LINK.format(k=0)]
    for k in range(1, count + 1):
        axis = ("1 0 0", "0 1 0", "0 0 1")[k % 3]
        parts += [LINK.format(k=k), JOINT.format(k=k, parent=0 if star else k - 1, kind=kind, axis=axis)]
    return "\n".join([*parts, "</robot>"])


@maker
def chain(folder: Path, draw: random.Random) -> Path:
    """Two thousand moving links, one after the other."""
    return put(folder, "arm.urdf", _chain(MANY, "revolute"))


@maker
def fixed_chain(folder: Path, draw: random.Random) -> Path:
    """Two thousand links that are fixed to each other."""
    text = _chain(MANY, "fixed").replace('type="fixed"', 'type="revolute"', 1)
    return put(folder, "arm.urdf", text)


@maker
def star(folder: Path, draw: random.Random) -> Path:
    """Two thousand moving links on one."""
    return put(folder, "arm.urdf", _chain(MANY, "revolute", star=True))


@maker
def ring(folder: Path, draw: random.Random) -> Path:
    """Two thousand links in a circle."""
    closing = JOINT.format(k=0, parent=MANY, kind="revolute", axis="1 0 0")
    return put(folder, "arm.urdf", _chain(MANY, "revolute").replace("</robot>", f"{closing}</robot>"))


@maker
def chain_mjcf(folder: Path, draw: random.Random) -> Path:
    """Two thousand bodies, each in the one before."""
    body = '<body pos="0 0 .1"><joint/><geom size=".01"/>'
    return put(folder, "arm.xml", f"<mujoco><worldbody>{body * MANY}{'</body>' * MANY}</worldbody></mujoco>")


@maker
def star_mjcf(folder: Path, draw: random.Random) -> Path:
    """Two thousand bodies on the world."""
    body = '<body pos="0 0 .1"><joint/><geom size=".01"/></body>'
    return put(folder, "arm.xml", f"<mujoco><worldbody>{body * MANY}</worldbody></mujoco>")


@maker
def chain_toml(folder: Path, draw: random.Random) -> Path:
    """Two thousand links of a mechanism of ours."""
    lines = ['title = "chain"', 'source = "made here"', "gravity_m_per_s2 = [0, 0, -9.81]"]
    for k in range(MANY):
        parent = f"l{k - 1}" if k else "world"
        lines += [f"[links.l{k}]", 'kind = "rigid"', "mass_kg = 1.0", "com_m = [0.0, 0.0, 0.05]"]
        lines += ["inertia_kgm2 = { xx = 0.01, yy = 0.01, zz = 0.01 }"]
        lines += [f"[joints.j{k}]", 'kind = "revolute"', f'parent = "{parent}"', f'child = "l{k}"', "axis = [0, 1, 0]"]
    (folder / "arm").mkdir()
    put(folder / "arm", "mechanism.toml", "\n".join(lines))
    return folder / "arm"


@maker
def chain_of_toml_urdf(folder: Path, draw: random.Random) -> Path:
    """A mechanism of ours whose URDF has two thousand links."""
    (folder / "arm").mkdir()
    put(folder / "arm", "arm.urdf", _chain(MANY, "revolute"))
    put(folder / "arm", "mechanism.toml", 'title = "arm"\nsource = "made here"\n[urdf]\npath = "arm.urdf"\n')
    return folder / "arm"


@maker
def own_parent(folder: Path, draw: random.Random) -> Path:
    """A joint whose child is its parent."""
    more = '<joint name="x" type="fixed"><parent link="upper"/><child link="upper"/></joint>'
    return put(folder, "arm.urdf", robot(more=more))


@maker
def mimic_circle(folder: Path, draw: random.Random) -> Path:
    """Joints that mimic each other."""
    text = _chain(2, "revolute")
    for k, other in ((1, 2), (2, 1)):
        head = f'<joint name="j{k}" type="revolute">'
        text = text.replace(head, f'{head}<mimic joint="j{other}"/>')
    return put(folder, "arm.urdf", text)


# Includes.


@maker
def includes_itself(folder: Path, draw: random.Random) -> Path:
    """MJCF that includes itself."""
    return put(folder, "arm.xml", '<mujoco><include file="arm.xml"/></mujoco>')


@maker
def includes_in_circle(folder: Path, draw: random.Random) -> Path:
    """Two files of MJCF that include each other, one of them by a longer way."""
    put(folder, "other.xml", f'<mujoco><include file="../{folder.name}/arm.xml"/></mujoco>')
    return put(folder, "arm.xml", '<mujoco><include file="other.xml"/></mujoco>')


@maker
def includes_doubling(folder: Path, draw: random.Random) -> Path:
    """Each file includes the next one twice, thirty levels deep."""
    for k in range(30):
        text = f'<include file="./f{k + 1}.xml"/><include file="././f{k + 1}.xml"/>'
        put(folder, f"f{k}.xml", f"<mujoco>{text}</mujoco>")
    put(folder, "f30.xml", "<mujoco/>")
    return put(folder, "arm.xml", '<mujoco><include file="f0.xml"/></mujoco>')


@maker
def includes_pipe(folder: Path, draw: random.Random) -> Path:
    """MJCF that includes a named pipe."""
    os.mkfifo(folder / "other.xml")
    return put(folder, "arm.xml", '<mujoco><include file="other.xml"/></mujoco>')


@maker
def includes_zeros(folder: Path, draw: random.Random) -> Path:
    """MJCF that includes /dev/zero."""
    return put(folder, "arm.xml", '<mujoco><include file="/dev/zero"/></mujoco>')


@maker
def includes_sparse(folder: Path, draw: random.Random) -> Path:
    """MJCF that includes a file of 8 GB."""
    os.truncate(put(folder, "other.xml", "<mujoco>"), HUGE)
    return put(folder, "arm.xml", '<mujoco><include file="other.xml"/></mujoco>')


@maker
def attaches_itself(folder: Path, draw: random.Random) -> Path:
    """MJCF that attaches itself as a model."""
    asset = '<asset><model name="m" file="arm.xml"/></asset>'
    frame = '<frame><attach model="m" body="b" prefix="p"/></frame>'
    body = '<body name="b"><joint/><geom size=".1"/></body>'
    return put(folder, "arm.xml", f'<mujoco model="arm">{asset}<worldbody>{frame}{body}</worldbody></mujoco>')


@maker
def sdf_includes_itself(folder: Path, draw: random.Random) -> Path:
    """SDF that includes itself."""
    return put(
        folder, "arm.sdf", '<sdf version="1.10"><model name="m"><include><uri>arm.sdf</uri></include></model></sdf>'
    )


@maker
def xacro(folder: Path, draw: random.Random) -> Path:
    """A xacro that includes itself."""
    text = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="r"><xacro:include filename="arm.urdf"/></robot>'
    return put(folder, "arm.urdf", text)


# Numbers of parts, and sizes, that no memory holds.


def _world(inside: str, before: str = "") -> str:
    return f"<mujoco>{before}<worldbody>{inside}</worldbody></mujoco>"


BODY = '<body><joint/><geom size=".1"/></body>'


@maker
def replicates(folder: Path, draw: random.Random) -> Path:
    """A body, a thousand million times."""
    return put(folder, "arm.xml", _world(f'<replicate count="1000000000" offset="0 0 1">{BODY}</replicate>'))


@maker
def replicates_nested(folder: Path, draw: random.Random) -> Path:
    """A body ten times, eight levels deep."""
    return put(folder, "arm.xml", _world('<replicate count="10">' * 8 + BODY + "</replicate>" * 8))


@maker
def grid(folder: Path, draw: random.Random) -> Path:
    """A flexible grid of 1e12 points."""
    inside = '<flexcomp type="grid" count="10000 10000 10000" spacing=".1 .1 .1" name="f" dim="3"/>'
    return put(folder, "arm.xml", _world(inside + BODY))


@maker
def cable(folder: Path, draw: random.Random) -> Path:
    """A cable of ten million bodies."""
    inside = (
        '<composite type="cable" curve="s" count="10000000 1 1" size="1"><geom type="capsule" size=".01"/></composite>'
    )
    return put(folder, "arm.xml", _world(inside))


@maker
def user_numbers(folder: Path, draw: random.Random) -> Path:
    """Two thousand million numbers of a user for each body."""
    return put(folder, "arm.xml", _world(BODY, '<size nuser_body="2000000000"/>'))


@maker
def memory_of_model(folder: Path, draw: random.Random) -> Path:
    """A model that asks for a million gigabytes."""
    return put(folder, "arm.xml", _world(BODY, '<size memory="1000000G"/>'))


@maker
def texture(folder: Path, draw: random.Random) -> Path:
    """A picture of 1e10 points."""
    before = '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>'
    return put(folder, "arm.xml", _world(BODY, before))


@maker
def field(folder: Path, draw: random.Random) -> Path:
    """A field of heights with 1e10 points."""
    before = '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
    return put(folder, "arm.xml", _world(f'<geom type="hfield" hfield="h"/>{BODY}', before))


@maker
def field_of_pipe(folder: Path, draw: random.Random) -> Path:
    """A field of heights that is read from a named pipe."""
    os.mkfifo(folder / "h.bin")
    before = '<asset><hfield name="h" file="h.bin" size="1 1 1 1"/></asset>'
    return put(folder, "arm.xml", _world(f'<geom type="hfield" hfield="h"/>{BODY}', before))


@maker
def unknown_plugin(folder: Path, draw: random.Random) -> Path:
    """A plugin that nobody has."""
    before = '<extension><plugin plugin="evil.so"/></extension>'
    return put(folder, "arm.xml", _world(BODY, before))


# USD.


@maker
def sublayers_itself(folder: Path, draw: random.Random) -> Path:
    """A stage that lies below itself."""
    return put(folder, "arm.usda", "#usda 1.0\n(\n    subLayers = [@arm.usda@]\n)\n")


@maker
def references_itself(folder: Path, draw: random.Random) -> Path:
    """A prim that refers to itself."""
    return put(
        folder, "arm.usda", '#usda 1.0\n(\n defaultPrim = "a"\n)\ndef Xform "a" (references = @arm.usda@</a>)\n{\n}\n'
    )


@maker
def sublayers_pipe(folder: Path, draw: random.Random) -> Path:
    """A stage whose layer is a named pipe."""
    os.mkfifo(folder / "other.usda")
    return put(folder, "arm.usda", "#usda 1.0\n(\n    subLayers = [@other.usda@]\n)\n")


@maker
def references_doubling(folder: Path, draw: random.Random) -> Path:
    """Prims that refer to the next one twice, thirty levels deep."""
    lines = ["#usda 1.0"]
    for k in range(30):
        lines += [f'def Xform "a{k}"', "{"]
        lines += [f'    def Xform "{side}" (references = </a{k + 1}>)\n    {{\n    }}' for side in ("x", "y")]
        lines += ["}"]
    lines += ['def Xform "a30"', "{", "}"]
    return put(folder, "arm.usda", "\n".join(lines))


@maker
def deep_usd(folder: Path, draw: random.Random) -> Path:
    """A hundred thousand prims, one in the other."""
    depth = 100_000
    return put(folder, "arm.usda", "#usda 1.0\n" + 'def "a" {\n' * depth + "}\n" * depth)


@maker
def torn_usd(folder: Path, draw: random.Random) -> Path:
    """A binary stage that is nothing but its first bytes."""
    return put(folder, "arm.usdc", b"PXR-USDC" + draw.randbytes(200))


@maker
def zip_bomb(folder: Path, draw: random.Random) -> Path:
    """An archive of USD with a gigabyte of spaces in it."""
    with (
        zipfile.ZipFile(folder / "arm.usdz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("arm.usda", "w") as stream,
    ):
        stream.write(b"#usda 1.0\n")
        for _ in range(1024):
            stream.write(b" " * (1 << 20))
    return folder / "arm.usdz"


# Logs.


@maker
def log_pipe(folder: Path, draw: random.Random) -> Path:
    """A log that is a named pipe."""
    os.mkfifo(folder / "log.csv")
    return folder / "log.csv"


@maker
def log_zeros(folder: Path, draw: random.Random) -> Path:
    """A log that is /dev/zero."""
    (folder / "log.csv").symlink_to("/dev/zero")
    return folder / "log.csv"


@maker
def log_bomb(folder: Path, draw: random.Random) -> Path:
    """A packed log of four gigabytes, packed twice as tight as it looks."""
    block = b"time_s,a\n" + b"0,0\n" * (1 << 18)
    with (folder / "log.csv.gz").open("wb") as stream:
        packed = gzip.compress(block, mtime=0)
        for _ in range(4096):
            stream.write(packed)
    return folder / "log.csv.gz"


@maker
def log_torn_table(folder: Path, draw: random.Random) -> Path:
    """A Parquet file that is nothing but its marks."""
    return put(folder, "log.parquet", b"PAR1" + draw.randbytes(300) + b"\xff\xff\xff\x7fPAR1")


@maker
def log_torn_matrix(folder: Path, draw: random.Random) -> Path:
    """A MAT file that says that two gigabytes follow."""
    head = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + b"\x00\x01IM"
    return put(
        folder, "log.mat", head + (14).to_bytes(4, "little") + (0x7FFFFFF0).to_bytes(4, "little") + draw.randbytes(64)
    )


@maker
def log_torn_bag(folder: Path, draw: random.Random) -> Path:
    """A bag of ROS that is nothing but its first line and noise."""
    return put(folder, "log.bag", b"#ROSBAG V2.0\n" + draw.randbytes(400))


@maker
def log_torn_mcap(folder: Path, draw: random.Random) -> Path:
    """An MCAP file whose first record says that 2^62 bytes follow."""
    return put(folder, "log.mcap", b"\x89MCAP0\r\n" + b"\x01" + (1 << 62).to_bytes(8, "little") + draw.randbytes(50))
