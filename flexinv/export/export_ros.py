"""export_ros: torques of a mechanism as a package of ROS 2, on the C library that `export_c` writes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from flexinv import __version__
from flexinv.errors import InputError
from flexinv.export.c_files import fill_template
from flexinv.export.export_c import ExportedLibrary, check_out_folder, export_c
from flexinv.export.machine_code import NATIVE
from flexinv.export.memory_image import ALIGNMENT
from flexinv.export.names import format_comment, format_markdown, format_numbers, format_string
from flexinv.export.written_files import LICENCE_FILE, read_licence, remove_on_failure, write_files
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Mechanism
from flexinv.validation import check_kind

LIBRARY_FOLDER = "library"  # in the package


def export_ros(
    mechanism: Mechanism, out: str | Path, targets: Sequence[str] = (NATIVE,), overwrite: bool = False,
    step: float | None = None, start: ArrayLike | None = None, initial: str = "static", spectral_radius: float = 0.8,
    payloads: Sequence[str] = (),
) -> ExportedLibrary:  # fmt: skip
    """Write a package of ROS 2 for a mechanism into a folder; return what was written [-].

    A rigid tree gets a plugin of `inverse_dynamics_solver`, and every mechanism feed-forward torques, with an example of a
    controller for `ros2_control`.  All arguments are those of `export_c`, which writes the library in the package.
    Raises InputError before anything is written: as `export_c`, and for joints whose coordinates are parts of a rotation.
    """
    check_kind("mechanism", mechanism, Mechanism)
    _check_joints(mechanism)
    folder = check_out_folder(out, overwrite)
    made = export_c(
        mechanism, folder / LIBRARY_FOLDER, targets=targets, overwrite=overwrite, step=step, start=start, initial=initial,
        spectral_radius=spectral_radius, payloads=payloads,
    )  # fmt: skip
    header = (made.folder / "include" / f"{made.name}.h").read_text(encoding="utf-8")
    cycle = None if step is None else float(step)
    package = _render_package(mechanism, made.name, cycle, f"{made.name}_start_at(" in header)
    with remove_on_failure(folder, [f"{LIBRARY_FOLDER}/{path}" for path in made.files]):
        write_files(folder, {path: text.encode() for path, text in package.items()})
    files = sorted([*package, *(f"{LIBRARY_FOLDER}/{path}" for path in made.files)])
    return ExportedLibrary(folder, f"{made.name}_ros", tuple(files), made.to_link)


def _check_joints(mechanism: Mechanism) -> None:
    """Refuse joints and loops of which messages of ROS say too little: one number for each joint."""
    for joint in mechanism.joints:
        if joint.nv and not KINDS[joint.kind].scalar:
            raise InputError(
                f"export_ros: joint {joint.name!r} of mechanism {mechanism.name!r} is {joint.kind}, and ROS has one position for "
                "a joint; call flexinv.export_c"
            )
    if mechanism.is_rigid and mechanism.closures:
        names = ", ".join(repr(closure.name) for closure in mechanism.closures)
        raise InputError(
            f"export_ros: mechanism {mechanism.name!r} has rigid loops ({names}), which take the motion of all joints; call "
            "flexinv.export_c"
        )


def _render_package(mechanism: Mechanism, name: str, step: float | None, starts_anywhere: bool) -> dict[str, str]:
    """Path in the package -> text."""
    solves = mechanism.is_rigid
    values = _collect_values(mechanism, name, step, starts_anywhere)
    values["solver_rules"] = fill_template("ros_solver_rules.txt", values) if solves else ""
    values["solver_notes"] = fill_template("ros_solver_notes.md", values) if solves else ""
    depends = ("inverse_dynamics_solver", "rclcpp") if solves else ()
    values["depends"] = "".join(f"  <depend>{one}</depend>\n" for one in depends)
    files = {
        "CMakeLists.txt": "ros_cmake.txt", "package.xml": "ros_package.xml", "README.md": "ros_readme.md",
        f"include/{name}_feed_forward.hpp": "ros_feed_forward.hpp", "src/feed_forward_controller.cpp": "ros_controller.cpp",
        f"{name}_controller.xml": "ros_controller.xml",
    }  # fmt: skip
    if solves:
        files |= {"src/solver.cpp": "ros_solver.cpp", f"{name}_solver.xml": "ros_solver.xml"}
    return {path: fill_template(template, values) for path, template in files.items()} | {LICENCE_FILE: read_licence()}


def _collect_values(mechanism: Mechanism, name: str, step: float | None, starts_anywhere: bool) -> dict[str, str]:
    """Name in the templates -> text."""
    m = mechanism
    places = list[str]()
    for joint in m.joints:
        first = m.q_slices[joint.name].start
        circle = str(KINDS[joint.kind].circle).lower()
        places += [f"{{{first + k}, {circle}}}" for k in range(joint.nv)]
    rate = (
        "" if step is None else f"The controller's `update_rate` is {1 / step:g} Hz, one over the step of the export."
    )
    return {
        "name": name, "NAME": name.upper(), "comment_title": format_comment(m.name), "markdown_title": format_markdown(m.name),
        "version": __version__, "alignment": str(ALIGNMENT), "places": ", ".join(places),
        "neutral_numbers": format_numbers(m.neutral), "link_strings": ", ".join(format_string(one.name) for one in m.links),
        "step_or_zero": repr(step or 0.0), "starts_anywhere": str(int(starts_anywhere)), "rate_note": rate,
        "driven_flags": ", ".join(str(bool(one)).lower() for one in m.actuated),
        "call": f"{name}_{'torque' if m.is_rigid else 'step'}",
        "rate_list": ", ".join(f"`{format_markdown(one)}`" for one in m.velocity_names),
        "gravity": ", ".join(f"{one:g}" for one in m.gravity),
    }  # fmt: skip
