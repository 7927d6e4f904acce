"""Exit code of a group of commands of click that is called without one."""

import click
from click.testing import CliRunner


@click.group()
def main():
    pass


print("exit", CliRunner().invoke(main, []).exit_code)
