"""The MJCF of a compiled model, every number with all its digits (MuJoCo's own writer keeps six).

Bodies, joints, sites; tendons between two sites; equalities of sites and of joints; a flex of dimension 1.  Capsules without
mass show the links.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

KINDS = {"mjJNT_FREE": "free", "mjJNT_BALL": "ball", "mjJNT_SLIDE": "slide", "mjJNT_HINGE": "hinge"}
EQUALITIES = {"mjEQ_CONNECT": "connect", "mjEQ_WELD": "weld", "mjEQ_JOINT": "joint"}

SHORT = 1e-9  # [m]: what is shorter nobody sees, and MuJoCo refuses what is as short as rounding
FLAGS = {"constraint": mujoco.mjtDisableBit.mjDSBL_CONSTRAINT, "contact": mujoco.mjtDisableBit.mjDSBL_CONTACT}


def write_mjcf(model: Any, name: str, young: float | None = None) -> str:
    """Return the MJCF of a compiled model; young : [Pa] of its flex, which the compiled model does not keep."""
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian", fusestatic="false")
    told = {
        "gravity": format_numbers(model.opt.gravity),
        "jacobian": "dense",
        "timestep": format_numbers(model.opt.timestep),
    }
    option = ET.SubElement(root, "option", told)
    if off := {word: "disable" for word, bit in FLAGS.items() if model.opt.disableflags & int(bit)}:
        ET.SubElement(option, "flag", off)
    bodies = {0: ET.SubElement(root, "worldbody")}
    for k in range(1, model.nbody):
        body = bodies[k] = ET.SubElement(bodies[model.body_parentid[k]], "body", _format_body(model, k))
        if model.body_mass[k] > 0:
            inertia = {"mass": model.body_mass[k], "diaginertia": model.body_inertia[k]}
            placed = {"pos": model.body_ipos[k], "quat": model.body_iquat[k]}
            ET.SubElement(body, "inertial", {key: format_numbers(value) for key, value in (placed | inertia).items()})
        for j in range(model.body_jntadr[k], model.body_jntadr[k] + model.body_jntnum[k]):
            ET.SubElement(body, "joint", _format_joint(model, j))
        _draw_body(model, body, k)
    for k in range(model.nsite):
        placed = {"pos": format_numbers(model.site_pos[k]), "quat": format_numbers(model.site_quat[k])}
        ET.SubElement(bodies[model.site_bodyid[k]], "site", {"name": model.site(k).name, **placed})
    _write_equalities(model, root)
    _write_tendons(model, root)
    if young is not None:
        _write_flex(model, root, young)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _format_body(model: Any, k: int) -> dict[str, str]:
    return {
        "name": model.body(k).name,
        "pos": format_numbers(model.body_pos[k]),
        "quat": format_numbers(model.body_quat[k]),
    }


def _draw_body(model: Any, body: ET.Element, k: int) -> None:
    """Add capsules from a body's frame to those that it carries, and to its centre of mass."""
    ends = [model.body_pos[c] for c in range(k + 1, model.nbody) if model.body_parentid[c] == k]
    for end in [*ends, model.body_ipos[k]]:
        if np.linalg.norm(end) > SHORT:
            shape = {
                "type": "capsule",
                "fromto": format_numbers([0, 0, 0, *end]),
                "size": format_numbers(np.linalg.norm(end) / 20),
            }
            ET.SubElement(body, "geom", shape | {"mass": "0", "contype": "0", "conaffinity": "0"})


def _format_joint(model: Any, j: int) -> dict[str, str]:
    kind = KINDS[mujoco.mjtJoint(model.jnt_type[j]).name]
    dof = model.jnt_dofadr[j]
    out = {"name": model.joint(j).name, "type": kind}
    if kind in ("slide", "hinge"):
        out["axis"] = format_numbers(model.jnt_axis[j])
    numbers = {"armature": model.dof_armature, "damping": model.dof_damping, "frictionloss": model.dof_frictionloss}
    out |= {key: format_numbers(values[dof]) for key, values in numbers.items() if np.any(values[dof])}
    if model.dof_frictionloss[dof]:
        out["solreffriction"] = format_numbers(model.dof_solref[dof])
    if model.jnt_limited[j]:
        out |= {"limited": "true", "range": format_numbers(model.jnt_range[j])}
    if model.jnt_actfrclimited[j]:
        out |= {"actuatorfrclimited": "true", "actuatorfrcrange": format_numbers(model.jnt_actfrcrange[j])}
    if np.any(model.jnt_stiffness[j]):
        out |= {
            "stiffness": format_numbers(model.jnt_stiffness[j]),
            "springref": format_numbers(model.qpos_spring[model.jnt_qposadr[j]]),
        }
    return out


def _write_equalities(model: Any, root: ET.Element) -> None:
    parent = ET.SubElement(root, "equality") if model.neq else root
    for k in range(model.neq):
        kind = EQUALITIES[mujoco.mjtEq(model.eq_type[k]).name]
        look = model.joint if kind == "joint" else model.site
        ends = {f"{'joint' if kind == 'joint' else 'site'}{n}": look(i).name
                for n, i in ((1, model.eq_obj1id[k]), (2, model.eq_obj2id[k]))}  # fmt: skip
        told = {"solref": format_numbers(model.eq_solref[k]), "solimp": format_numbers(model.eq_solimp[k])}
        curve = {"polycoef": format_numbers(model.eq_data[k][:5])} if kind == "joint" else {}
        ET.SubElement(parent, kind, {"name": model.equality(k).name, **ends, **curve, **told})


def _write_tendons(model: Any, root: ET.Element) -> None:
    parent = ET.SubElement(root, "tendon") if model.ntendon else root
    for k in range(model.ntendon):
        numbers = {"stiffness": model.tendon_stiffness[k], "damping": model.tendon_damping[k]}
        numbers |= {"springlength": model.tendon_lengthspring[k]}
        words = {key: format_numbers(value) for key, value in numbers.items()}
        tendon = ET.SubElement(parent, "spatial", {"name": model.tendon(k).name, **words})
        for w in range(model.tendon_adr[k], model.tendon_adr[k] + model.tendon_num[k]):
            ET.SubElement(tendon, "site", site=model.site(model.wrap_objid[w]).name)


def _write_flex(model: Any, root: ET.Element, young: float) -> None:
    """Add the only flex, of dimension 1; names in its list are parted by blanks, so bodies' names have none."""
    for body in root.iter("body"):
        body.set("name", body.get("name", "").replace(" ", "_"))
    carriers = [model.body(k).name.replace(" ", "_") for k in model.flex_vertbodyid]
    where = {"vertex": format_numbers(model.flex_vert), "element": " ".join(map(str, model.flex_elem))}
    told = {"name": "rod", "dim": "1", "radius": format_numbers(model.flex_radius[0]), "body": " ".join(carriers)}
    flex = ET.SubElement(ET.SubElement(root, "deformable"), "flex", told | where)
    ET.SubElement(flex, "contact", contype="0", conaffinity="0")
    ET.SubElement(flex, "elasticity", young=format_numbers(young), poisson="0")
    ET.SubElement(flex, "edge", stiffness=format_numbers(model.flex_edgestiffness[0]))


def format_numbers(numbers: Any) -> str:
    """Return numbers in the shortest form that gives them back."""
    return " ".join(repr(float(x)) for x in np.ravel(numbers))
