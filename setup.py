"""Wheels with machine code: what `make wheel` has left in build/machine_code goes into the package, and names its platform."""

from pathlib import Path
from shutil import copytree

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

CODE = Path("build/machine_code")


class BuildWithCode(build_py):
    """Copies the machine code beside the sources that it was made of."""

    def run(self) -> None:
        """Build, and copy."""
        super().run()
        if CODE.is_dir() and not self.editable_mode:
            copytree(CODE, Path(self.build_lib) / "flexinv" / "machine_code", dirs_exist_ok=True)


class WheelOfPlatform(bdist_wheel):
    """A wheel for one Python and one system where there is machine code in it."""

    def finalize_options(self) -> None:
        """Say so in the wheel's name."""
        super().finalize_options()
        self.root_is_pure = not CODE.is_dir()


setup(cmdclass={"build_py": BuildWithCode, "bdist_wheel": WheelOfPlatform})
