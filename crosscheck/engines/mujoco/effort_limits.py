"""Largest efforts of joints as MuJoCo's actuators and joints state them: forcerange, ctrlrange of motors, actuatorfrcrange.

    actuator      its force, within forcerange and, of a motor, gain times ctrlrange, times its gear; a motor's control is its
                  force: that of a plugin, or of an actuator with feedback or states, is a setpoint, whose range bounds no effort
    joint         the sum of its actuators, within actuatorfrcrange; bounded only where all of them are

A mechanism has one number for both directions: the larger; where they differ, that is said.  Source: mujoco 4.0.0, mjmodel.h.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from crosscheck.engines.mujoco.compiled.names import find_actuators, read_gear, resolve_joint_name

Range = tuple[float, float]
FREE: Range = (-np.inf, np.inf)
SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
SAME = 1e-9  # relative


def read_effort_limits(model: Any) -> tuple[dict[int, float], list[str]]:
    """Return by number of a hinge or slide its largest effort [N m], [N], and in words those that one direction has less of."""
    found: dict[int, float] = {}
    words: list[str] = []
    for joint in range(model.njnt):
        if mujoco.mjtJoint(int(model.jnt_type[joint])) not in SCALAR:
            continue
        low, high = _compute_effort_range(model, joint)
        if not (np.isfinite(low) or np.isfinite(high)):
            continue
        found[joint] = largest = max(abs(low), abs(high))
        if abs(low + high) > SAME * largest:
            words.append(
                f"effort of joint {resolve_joint_name(model, joint)}: {low:.6g} to {high:.6g}; "
                "a mechanism has one limit for both directions"
            )
    return found, words


def _compute_effort_range(model: Any, joint: int) -> Range:
    effort_range = FREE
    if model.jnt_actfrclimited[joint]:
        effort_range = (float(model.jnt_actfrcrange[joint][0]), float(model.jnt_actfrcrange[joint][1]))
    acting = list(_list_actuator_ranges(model, joint))
    if not acting:
        return effort_range
    return max(effort_range[0], sum(low for low, _ in acting)), min(effort_range[1], sum(high for _, high in acting))


def _list_actuator_ranges(model: Any, joint: int) -> Iterator[Range]:
    """Yield the range of effort of every actuator that drives one joint alone."""
    for k in find_actuators(model, joint):
        gear = read_gear(model, k)
        low, high = _read_force_range(model, k)
        ends = sorted((gear * low, gear * high)) if gear else [0.0, 0.0]
        yield ends[0], ends[1]


def _read_force_range(model: Any, k: int) -> Range:
    low, high = FREE
    if model.actuator_forcelimited[k]:
        low, high = (float(x) for x in model.actuator_forcerange[k])
    motor = (
        model.actuator_gaintype[k] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_dyntype[k] == mujoco.mjtDyn.mjDYN_NONE
        and model.actuator_plugin[k] < 0
        and model.actuator_ctrlnum[k] == 1
    )
    control = int(model.actuator_ctrladr[k])
    clamped = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    if motor and clamped and model.actuator_ctrllimited[control]:
        gain = float(np.ravel(model.actuator_gainprm[k])[0])
        ends = sorted(gain * float(x) for x in model.actuator_ctrlrange[control])
        low = max(low, ends[0])
        high = min(high, ends[1])
    return low, high
