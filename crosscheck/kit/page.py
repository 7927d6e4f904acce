"""The page of a case kit: frames, signs, and what to write back, for somebody who has never heard of this project."""

from __future__ import annotations

from crosscheck.kit.tables import CaseFile

PAGE = """# {mechanism}/{case}: a case kit, format {format}

{title}

Compute what `case.json` asks for, and write it as files.  Everything is in SI units and radians.

| file | content |
|---|---|
| `case.json` | the mechanism with every default written out, the times, and what is asked for; `schema/` describes every key |
{files}

## The mechanism
* A **link frame** is the frame of the joint that carries the link, moved by the joint. A **joint frame** is stated in the
  frame of the parent link (on a beam in the frame of its section at `station`): x_parent = position + rotation x_joint.
* **Joints**: revolute, continuous: R = exp(axis q). prismatic: p = axis q. helical: R = exp(axis q),
  p = axis pitch q / (2 pi). universal: R = exp(axis q1) exp(second_axis q2).
  spherical: q is a quaternion x, y, z, w of the child in the joint frame, its velocity the angular velocity along the axes of the
  child. free: position and quaternion; velocity linear, then angular, both along the axes of the child (v = R^T dp/dt), and
  accelerations are the rates of those numbers (dv/dt = R^T d2p/dt2 - w x v).
  continuous: q is cos and sin of the angle, its velocity the rate of the angle. fixed: no coordinate.
* **Bodies**: inertia about the centre of mass, along the axes of the link frame. Gravity is in the world frame.
* **Beams**: geometrically exact Timoshenko beams along x of their root frame; the effort of a section is stiffness times
  strain (stretch, shear y, shear z, twist, bending y, bending z) plus `damping` times the rate of strain.{meshes}
* **Effort** of a drive: what inverse dynamics of the bodies gives, + rotor_inertia qdd + damping qd + friction sign(qd)
  + stiffness (q - rest).
* **Closures** tie the second frame to the first. Where redundant constraints or drives leave efforts open, the answer is that
  with the least sum of weight tau^2.

## The motion
`motion.csv` has q, qd, qdd of every coordinate that is given, every {spacing:g} s. Joints that it leaves out follow: in loops by
the closures, from `start` (a guess, which selects the branch); in open trees by dynamics, without effort.{jumps}
Times of the answer: 0, {sample:g}, ..., {end:g} s ({samples} rows).{initial}{refined}

## The answer
A folder with

* `series.csv`: the first column `time [s]`, then a column for each series, as `torque/NAME [N m]`; with the half-width of its
  error bar, where you know it, in a column `torque/NAME error [N m]`. No other units, no other names, full digits (%.17g).
{asked}
* `certificate.json` (if you can): what your own model says of itself at the configurations of `probe.csv`; every key may
  be left out.
* `meta.json` (if you like): `{{"tool": "...", "version": "...", "case": "{digest}", "wall_time": 0.1}}`. A program that cannot
  do this case writes `{{"skipped": "why"}}` there, and no series.
"""
MESHES = """
* **Meshed links** (`part`) are finite-element meshes, their matrices in an archive. The points of the interface `root` move
  with the link frame, those of the others with (`average`: on average as) a frame of their own, to which joints, bodies and
  closures attach by `interface`. Strains are small, turns of the link are not."""
JUMPS = "\nAccelerations jump at {times} s: there it has the value after the jump."
STATIC = " At time 0 all is at rest in equilibrium under gravity and all loads: beams and meshes hang through."
UNDEFORMED = " At time 0 beams and meshes are undeformed, and move as their joints do."
REFINED = (
    "\nThis is run {refinement} of a refinement: take your steps and elements {refinement} times as fine as in run 1."
)


def render_readme(file: CaseFile, files: dict[str, str], spacing: float) -> str:
    """Return README.md of a kit; files : what lies beside case.json, with its content; spacing : of motion.csv [s]."""
    case = file.case
    meshed = any(link.part is not None for link in file.mechanism.links)
    bends = meshed or any(link.beam is not None for link in file.mechanism.links)
    static = STATIC if case.initial == "static" else UNDEFORMED
    return PAGE.format(
        mechanism=file.mechanism.name,
        case=case.name,
        format=file.format,
        title=case.title or file.mechanism.title,
        files="\n".join(f"| `{name}` | {words} |" for name, words in files.items()),
        spacing=spacing,
        jumps=JUMPS.format(times=", ".join(f"{t:g}" for t in case.jumps)) if case.jumps else "",
        sample=case.sample,
        end=case.end,
        samples=case.samples,
        initial=static if bends else "",
        meshes=MESHES if meshed else "",
        refined=REFINED.format(refinement=case.refinement) if case.refinement > 1 else "",
        asked="\n".join(f"  * {one.quantity}: {one.meaning}" for one in case.asked),
        digest=file.digest,
    )
