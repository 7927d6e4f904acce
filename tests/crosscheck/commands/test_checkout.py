"""Commands that need a checkout say so where the packages are installed alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from crosscheck import checkout
from crosscheck.cli import main

COMMANDS = (["bench", "--quick"], ["selftest", "--beyond"], ["nightly", "--bench", "rigid_3r"])


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_command_for_developers_says_that_it_needs_a_checkout(
    words: list[str], tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(checkout, "ROOT", tmp_path)
    result = CliRunner().invoke(main, [*words, "--models", str(root / "models")])
    assert result.exit_code == 2
    assert "needs a checkout of flexinv" in result.output.replace("\n", " ")
    assert "Traceback" not in result.output


def test_a_checkout_has_what_its_commands_import() -> None:
    assert checkout.open_checkout_module("benchmarks.parts", "crosscheck bench").PARTS
    assert checkout.open_checkout_module("campaigns.beyond.campaign", "crosscheck selftest --beyond").CAMPAIGNS
