"""Reproduction: pins of two environments, one script, one command, and a text for the package's tracker."""

from __future__ import annotations

import platform
import shlex
import shutil
from pathlib import Path

from crosscheck import output_folder as owned
from crosscheck.bisect.answer import Answer, ChangeReport
from crosscheck.bisect.script import LAUNCHER, Script, copy_files
from crosscheck.bisect.trials import Trials
from crosscheck.run.isolation import open_scratch_folder

RUN = """#!/bin/sh
# Makes two environments beside this file, {before} and {after}, and runs one script in both.
set -eu
cd "$(dirname "$0")"
python=${{PYTHON:-python3}}
for release in {before} {after}; do
    if [ ! -d "environment-$release" ]; then
        "$python" -m venv "environment-$release"
        "environment-$release/bin/python" -m pip install --quiet --no-deps --require-hashes{wheels} -r "pins-$release.txt"
    fi
    rm -rf "work-$release"
    cp -R script "work-$release"
    echo "=== {package} $release"
    (cd "work-$release" && {variables}PATH="../environment-$release/bin:$PATH" {command}) || echo "exit code $?"
done
"""

ISSUE = """# {package} {after} gives another result than {before}

{words}

| | {before} | {after} |
|---|---|---|
| result | {old} | {new} |
| Python | {python} | {python} |
| system | {system} | {system} |

## To reproduce

`sh reproduce.sh` in the attached folder makes both environments from wheels with hashes and runs

    {shown}

## What else differs between both environments

{others}

Found by bisecting {releases} releases with {environments} environments.
"""


def write_reproduction(answer: Answer, change: ChangeReport, trials: Trials, folder: Path) -> None:
    """Write the folder of a reproduction; a folder of an earlier answer is replaced.  Raises OSError."""
    script = trials.question.script
    with open_scratch_folder() as made:
        copy_files(script, made)
        if script.judges and script.program is not None and script.program.suffix == ".py":
            shutil.copyfile(LAUNCHER, made / LAUNCHER.stem)
        for file in sorted(path for path in made.rglob("*") if path.is_file()):
            target = folder / "script" / file.relative_to(made)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, owned.add_to_folder_list(target))
    for release in (change.before, change.after):
        owned.write(folder / f"pins-{release}.txt", trials.trials[release].pins)
    wheels = "" if trials.store.installer.sources else " --only-binary :all:"
    owned.write(
        folder / "reproduce.sh",
        RUN.format(
            before=change.before, after=change.after, package=trials.question.package, wheels=wheels,
            variables="PYTHONHASHSEED=0 OMP_NUM_THREADS=1 ", command=_format_command(script),
        ),
    )  # fmt: skip
    owned.write(folder / "issue.md", format_issue(answer, change, script))


def _format_command(script: Script) -> str:
    """Return the command of the script for a shell, in the folder of its copy."""
    program = script.program
    if program is None:
        return shlex.join(script.words)
    if program.suffix != ".py":
        return shlex.join([f"./{script.names[0]}", *script.names[1:]])
    launcher = [LAUNCHER.stem] if script.judges else []
    return shlex.join(["python", *launcher, *script.names])


def format_issue(answer: Answer, change: ChangeReport, script: Script) -> str:
    """Return the text for the tracker of the package."""
    shown = shlex.join([*(["python"] if script.names[0].endswith(".py") else []), *script.names])
    words = [one for one in answer.words if change.after in one] or answer.words
    return ISSUE.format(
        package=answer.package,
        before=change.before,
        after=change.after,
        words="\n\n".join([*words, *filter(None, [change.cause])]),
        old=change.old_value,
        new=change.new_value,
        python=platform.python_version(),
        system=f"{platform.system()} {platform.machine()}",
        shown=shown,
        others="\n".join(describe_others(change)),
        releases=answer.costs.releases,
        environments=answer.costs.environments,
    )


def describe_others(change: ChangeReport, most: int | None = None) -> list[str]:
    """Return all else that differs between both sides of a change, a line each; most : default options that are shown."""
    lines = [f"* {name} {old or '(not there)'} -> {new or '(not there)'}" for name, old, new in change.packages]
    lines += [f"* {change.origin}"] if change.origin else []
    if not change.packages:
        lines.append("* no other package")
    if change.defaults is None:
        return [*lines, "* default options: this package has no probe that asks for them"]
    if not change.defaults:
        return [*lines, "* default options: none of those that it states"]
    shown = change.defaults[:most]
    lines += [f"* default of {name}: {old or '(not there)'} -> {new or '(not there)'}" for name, old, new in shown]
    left = len(change.defaults) - len(shown)
    return [*lines, f"* and {left} more default options, in answer.json"] if left else lines
