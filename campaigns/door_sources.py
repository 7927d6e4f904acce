"""Answers of flexinv to beams with one change of the mechanism, at 1, 2 and 4 times as fine steps and meshes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import flexinv
from flexinv.files.load_cases import load_cases
from flexinv.model.mechanism import Mechanism

BEAMS = ("strip", "boom")
EXTRA = 2  # the coarsest run has half the step of the case: records and programs are honest about better than the limit


def write_sources(folder: Path, machines: list[str]) -> None:
    """Write ``sources/MACHINE/CHANGE-LEVEL.csv`` of the beams among the machines."""
    for machine in machines:
        if machine in BEAMS:
            place = folder / "models" / machine
            mechanism = flexinv.load_mechanism(place)
            case = load_cases(place, mechanism)["move"]
            for name, changed in changes(mechanism).items():
                for level in (1, 2, 4):
                    write_source(folder / "sources" / machine / f"{name}-{level}.csv", changed, case, level)


def write_source(file: Path, mechanism: Mechanism, case, level: int) -> None:
    """Solve, and write torque and deflection at the samples of the case."""
    step = case.step / (EXTRA * level)
    (link,) = mechanism.links
    every = round(case.sample / step)
    solution = flexinv.solve(mechanism, case.motion, step=step, end=case.end, initial=case.initial)
    columns = [solution.time, solution.torque[:, 0], *solution.deflection[link.name].T]
    heads = [
        "time [s]",
        f"torque/{mechanism.velocity_names[0]} [N m]",
        *(f"deflection/{link.name}/{c} [m]" for c in "xyz"),
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = [",".join(format(x, ".17g") for x in line) for line in np.stack(columns, axis=1)[::every]]
    file.write_text("\n".join([",".join(heads), *lines]) + "\n")


def changes(mechanism: Mechanism) -> dict[str, Mechanism]:
    """Return the mechanism, and those with one fault, by its name; a payload is changed where there is one."""
    (link,) = mechanism.links
    (joint,) = mechanism.joints
    section = link.beam.section
    shear = np.array([1.0, 2e-3, 2e-3, 1.0, 1.0, 1.0])
    bending = np.array([1.0, 1.0, 1.0, 1.0, 0.95, 0.95])
    beams = {
        "heavy": {"section": replace(section, mass_per_length=section.mass_per_length * 1.03)},
        "soft": {"section": replace(section, stiffness=section.stiffness * bending)},
        "sheared": {"section": replace(section, stiffness=section.stiffness * shear)},
        "no_section_inertia": {"section": replace(section, rotary_inertia=section.rotary_inertia * 500.0)},
        "longer": {"length": link.beam.length * 1.01},
    }
    made = {"right": mechanism}
    for name, change in beams.items():
        made[name] = replace(mechanism, links=(replace(link, beam=replace(link.beam, **change)),))
    if link.bodies:
        (body,) = link.bodies
        inertia = body.inertia
        loads = {
            "load_mirrored": replace(inertia, com=-inertia.com),
            "load_heavier": replace(inertia, mass=inertia.mass * 1.03),
            "load_point": replace(inertia, tensor=0.0 * inertia.tensor),
        }
        for name, load in loads.items():
            made[name] = replace(mechanism, links=(replace(link, bodies=(replace(body, inertia=load),)),))
        made["no_load"] = replace(mechanism, links=(replace(link, bodies=()),))
        made["weightless"] = replace(mechanism, gravity=np.zeros(3))
        made["no_rotor"] = replace(mechanism, joints=(replace(joint, rotor_inertia=0.0),))
        made["undamped"] = replace(mechanism, joints=(replace(joint, damping=0.0),))
        made["overdamped"] = replace(mechanism, joints=(replace(joint, damping=3.0 * joint.damping),))
    return made
