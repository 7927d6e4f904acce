"""DART's reader: a URDF is itself, a skeleton in memory is a description, and what its reader of SDF loses is named."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("dartpy", reason="DART is not installed (python -m pip install dartpy)")

import dartpy as dart
from arm_texts import ARM_SDF, arm

import crosscheck
from flexinv.errors import InputError


def test_its_reader_of_urdf_keeps_damping_friction_and_mimics(tmp_path: Path) -> None:
    file = arm(tmp_path)
    assert crosscheck.compare(file, f"{file}@dart").equal


def test_a_heavier_link_in_memory_is_named(tmp_path: Path) -> None:
    file = arm(tmp_path)
    loader, options = dart.utils.DartLoader(), dart.utils.DartLoaderOptions()
    options.mDefaultRootJointType = dart.utils.DartLoaderRootJointType.FIXED
    loader.setOptions(options)
    skeleton = loader.parseSkeleton(dart.common.Uri(f"file://{file}"))
    skeleton.getBodyNode("lower").setMass(2.625)
    found = crosscheck.compare(arm(tmp_path, ('<mimic joint="grip"/>', "")), skeleton, judge=["rigid"])
    assert [(d.cause, d.place) for d in found.differences] == [("mass", "link lower")]


def test_sdf_beyond_1_6_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "arm.sdf").write_text(ARM_SDF)
    with pytest.raises(InputError, match=r"SDF beyond 1\.6"):
        crosscheck.compare(f"{tmp_path}/arm.sdf@dart", arm(tmp_path))
