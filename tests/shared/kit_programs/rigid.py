"""Answer a case kit of rigid links with nothing but numpy: trees and closed loops of revolute and prismatic joints.

python rigid.py KIT OUT
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np

KNOWN = ("revolute", "prismatic", "fixed")


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def cross(a, b):
    """What np.cross gives, which takes ten times as long for two vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def turn(axis, angle):
    k = skew(np.asarray(axis))
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


class Robot:
    """Links with pose, Jacobians (3, nv) and accelerations, by forward recursion in the world frame."""

    def __init__(self, kit):
        self.data = json.loads((kit / "case.json").read_text())
        mechanism = self.data["mechanism"]
        self.joints, self.gravity = mechanism["joints"], np.array(mechanism["gravity"])
        self.links = {link["name"]: link for link in mechanism["links"]}
        self.closures = mechanism["closures"]
        self.names = [v["name"] for v in self.data["case"]["velocities"]]

    def move(self, q, v, a):
        n = len(q)
        z = np.zeros((3, n))
        none = np.zeros(3)
        seats = {"world": (none, np.eye(3), z, z, none, none, none, none)}
        for joint in self.joints:
            x, r, jv, jw, lin, ang, acc, alp = seats[joint["parent"]]
            p, own = (np.array(joint["frame"][key]) for key in ("position", "rotation"))
            offset, frame = r @ p, r @ own
            x, lin, acc = (
                x + offset,
                lin + cross(ang, offset),
                acc + cross(alp, offset) + cross(ang, cross(ang, offset)),
            )
            jv = jv - skew(offset) @ jw
            if joint["kind"] != "fixed":
                k = self.names.index(joint["v"][0])
                axis = frame @ np.array(joint["axis"])
                column = np.eye(n)[k]
                if joint["kind"] == "revolute":
                    frame = frame @ turn(joint["axis"], q[k])
                    alp = alp + axis * a[k] + cross(ang, axis) * v[k]
                    ang, jw = ang + axis * v[k], jw + np.outer(axis, column)
                else:
                    slide = axis * q[k]
                    acc = (
                        acc
                        + cross(alp, slide)
                        + cross(ang, cross(ang, slide))
                        + 2.0 * cross(ang, axis) * v[k]
                        + axis * a[k]
                    )
                    lin = lin + cross(ang, slide) + axis * v[k]
                    jv = jv - skew(slide) @ jw + np.outer(axis, column)
                    x = x + slide
            seats[joint["child"]] = (x, frame, jv, jw, lin, ang, acc, alp)
        return seats

    def point(self, seat, place):
        """Point of a link: place, Jacobian, acceleration."""
        x, r, jv, jw, _, ang, acc, alp = seat
        d = r @ np.array(place)
        return x + d, jv - skew(d) @ jw, acc + cross(alp, d) + cross(ang, cross(ang, d))

    def torque(self, q, v, a):
        """Efforts of the tree without closures: bodies, and what the drives carry."""
        seats = self.move(q, v, a)
        tau = np.zeros(len(q))
        for name, link in self.links.items():
            for body in link["bodies"]:
                _, j, acc = self.point(seats[name], body["com"])
                _, r, _, jw, _, ang, _, alp = seats[name]
                inertia = r @ np.array(body["inertia"]) @ r.T
                tau += j.T @ (body["mass"] * (acc - self.gravity)) + jw.T @ (inertia @ alp + cross(ang, inertia @ ang))
        for joint in self.joints:
            for name in joint["v"]:
                k = self.names.index(name)
                tau[k] += joint["rotor_inertia"] * a[k] + joint["damping"] * v[k] + joint["friction"] * np.sign(v[k])
                tau[k] += joint["stiffness"] * (q[k] - joint["rest"])
        return tau

    def rows(self, q, v, a):
        """Equations of all revolute closures: values, Jacobian, second derivative with these accelerations."""
        seats = self.move(q, v, a)
        phi, g, second = [], [], []
        for closure in self.closures:
            ends = [closure[key] for key in ("first", "second")]
            (x1, j1, a1), (x2, j2, a2) = (self.point(seats[e["link"]], e["frame"]["position"]) for e in ends)
            phi, g, second = [*phi, *(x2 - x1)], [*g, *(j2 - j1)], [*second, *(a2 - a1)]
            turned = [(seats[e["link"]], seats[e["link"]][1] @ np.array(e["frame"]["rotation"])) for e in ends]
            (one, r1), (two, r2) = turned
            n = np.array(closure["axis"])
            p = np.linalg.svd(n[None])[2][1:]
            w = r2 @ n
            for u in (r1 @ p[0], r1 @ p[1]):
                phi.append(u @ w)
                g.append(cross(w, u) @ (two[3] - one[3]))
                bend = u @ (cross(two[7], w) + cross(two[5], cross(two[5], w)))
                bend += w @ (cross(one[7], u) + cross(one[5], cross(one[5], u)))
                second.append(bend + 2.0 * cross(one[5], u) @ cross(two[5], w))
        return np.array(phi), np.array(g), np.array(second)


def read_motion(kit, robot):
    """Times, and q, v, a of all velocities; joints that are not given are 0."""
    with (kit / "motion.csv").open() as stream:
        header, *rows = list(csv.reader(stream))
    table, n = np.array(rows, dtype=float), len(robot.names)
    out = {part: np.zeros((len(table), n)) for part in ("q", "qd", "qdd")}
    for k, head in enumerate(header[1:], 1):
        part, name = head.partition(" [")[0].split("/", 1)
        out[part][:, robot.names.index(name)] = table[:, k]
    return table[:, 0], out["q"], out["qd"], out["qdd"]


def close(robot, q, v, a, given, guess):
    """Joints of a closed loop that the motion leaves out: Newton, then rates and accelerations."""
    free = ~given
    q = np.where(free, guess, q)
    for _ in range(30):
        phi, g, _ = robot.rows(q, 0 * q, 0 * q)
        step = -np.linalg.lstsq(g[:, free], phi, rcond=1e-10)[0]
        q[free] += step
        if np.abs(step).max() < 1e-14:
            break
    v, a = np.where(free, 0.0, v), np.where(free, 0.0, a)
    v[free] = np.linalg.lstsq(g[:, free], -g @ v, rcond=1e-10)[0]
    a[free] = np.linalg.lstsq(g[:, free], -robot.rows(q, v, a)[2], rcond=1e-10)[0]
    return q, v, a, g


def answer(kit, out):
    robot = Robot(kit)
    case = robot.data["case"]
    digest = robot.data["digest"]
    out.mkdir(exist_ok=True)
    if kinds := sorted(
        {j["kind"] for j in robot.joints} - set(KNOWN) | {c["kind"] for c in robot.closures} - {"revolute"}
    ):
        (out / "meta.json").write_text(json.dumps({"skipped": f"numpy here has no {', '.join(kinds)}"}))
        return
    if case["integrated"]:
        (out / "meta.json").write_text(json.dumps({"skipped": "numpy here does not integrate in time"}))
        return
    time, q, v, a = read_motion(kit, robot)
    given = np.array([x["given"] for x in case["velocities"]])
    driven = np.array([x["actuated"] for x in case["velocities"]])
    weights = np.array([j["weight"] for j in robot.joints for _ in j["v"]])
    guess = np.array([case["start"].get(j["name"], [0.0])[0] for j in robot.joints for _ in j["v"]])
    efforts, tips = [], []
    for k in range(len(time)):
        if robot.closures:
            q[k], v[k], a[k], g = close(robot, q[k], v[k], a[k], given, guess)
            guess = q[k] + (v[k] * (time[1] - time[0]) if k + 1 < len(time) else 0.0)
            tau = np.zeros(len(driven))
            tau[driven] = shared(g, driven, weights, robot.torque(q[k], v[k], a[k]))
        else:
            tau = robot.torque(q[k], v[k], a[k])
        efforts.append(tau)
        seats = robot.move(q[k], v[k], a[k])
        tips.append(np.concatenate([robot.point(seats[n], link["tip"])[0] for n, link in robot.links.items()]))
    units = [x["effort_unit"] for x in case["velocities"]]
    header = [f"torque/{n} [{u}]" for n, u in zip(robot.names, units, strict=True)]
    header += [f"tip/{n}/{c} [m]" for n in robot.links for c in "xyz"]
    with (out / "series.csv").open("w") as stream:
        stream.write(",".join(["time [s]", *header]) + "\n")
        for t, e, x in zip(time, efforts, tips, strict=True):
            stream.write(",".join(repr(float(value)) for value in (t, *e, *x)) + "\n")
    (out / "certificate.json").write_text(json.dumps(certificate(kit, robot)))
    meta = {"tool": "numpy", "version": np.__version__, "case": digest, "formulation": "Jacobians in the world frame"}
    (out / "meta.json").write_text(json.dumps(meta))


def shared(g, driven, weights, tau):
    """Efforts of the drives: the least sum of weight tau^2 that leaves nothing at joints without a drive."""
    _, s, vt = np.linalg.svd(g)
    motions = vt[int((s > 1e-10 * s[0]).sum()) :]
    scaled = motions[:, driven] / np.sqrt(weights[driven])
    return np.linalg.lstsq(scaled, motions @ tau, rcond=1e-10)[0] / np.sqrt(weights[driven])


def certificate(kit, robot):
    with (kit / "probe.csv").open() as stream:
        _, *rows = list(csv.reader(stream))
    n = len(robot.names)
    zero, rest = np.zeros(n), []
    gravity = robot.gravity
    bare = [dict(j, damping=0.0, friction=0.0, stiffness=0.0) for j in robot.joints]
    robot.joints = bare
    matrices = []
    for row in rows:
        q = np.array(row, dtype=float)
        rest.append(robot.torque(q, zero, zero).tolist())
        robot.gravity = 0 * gravity
        matrices.append(np.array([robot.torque(q, zero, unit) for unit in np.eye(n)]).T.tolist())
        robot.gravity = gravity
    mass = sum(b["mass"] for name, link in robot.links.items() for b in link["bodies"])
    return {
        "mass": mass,
        "mass_matrix": matrices,
        "gravity": rest,
        "order": [j["name"] for j in robot.joints if j["v"]],
    }


if __name__ == "__main__":
    answer(Path(sys.argv[1]), Path(sys.argv[2]))
