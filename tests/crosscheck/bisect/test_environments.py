"""Environments are made once, kept within their room, and never taken half made; failures of installers have the right name."""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path

import pytest
from local_index import UnzippingInstaller, write_wheel

from crosscheck.bisect import environments
from crosscheck.bisect.environments import (
    WHOLE,
    EnvironmentStore,
    EnvironmentWish,
    compute_folder_size,
    find_store_folder,
)
from crosscheck.bisect.installers import (
    CannotInstall,
    Index,
    InstallerError,
    ProgramAnswer,
    choose_installer,
    make_uv_settings,
    read_pins,
)
from crosscheck.bisect.pythons import find_pythons
from crosscheck.bisect.surroundings import make_installer_environment, make_script_environment
from flexinv.errors import InputError

PYTHON = find_pythons([])[0]


@pytest.fixture
def store(tmp_path: Path) -> EnvironmentStore:
    for k in range(5):
        write_wheel(tmp_path / "wheels", "ball", f"1.{k}", "x" * 0)
    return EnvironmentStore(tmp_path / "store", UnzippingInstaller(tmp_path / "wheels"))  # type: ignore[arg-type]


def wish(version: str) -> EnvironmentWish:
    return EnvironmentWish(PYTHON, (f"ball=={version}",))


def test_an_environment_is_made_once(store: EnvironmentStore) -> None:
    for _ in range(2):
        with store.open_environment(wish("1.0")) as environment:
            assert environment.versions == {"ball": "1.0"}
            assert Path(environment.python).exists()
    assert (store.made, store.reused) == (1, 1)


def test_one_that_is_half_made_is_made_anew(store: EnvironmentStore) -> None:
    with store.open_environment(wish("1.0")) as environment:
        (environment.folder / WHOLE).unlink()
        (environment.folder / "rubbish").touch()
    with store.open_environment(wish("1.0")) as environment:
        assert environment.made
        assert not (environment.folder / "rubbish").exists()


def test_of_one_that_fails_nothing_is_left(store: EnvironmentStore) -> None:
    installer = store.installer
    assert isinstance(installer, UnzippingInstaller)
    installer.refused["ball==1.0"] = "no wheel"
    with pytest.raises(CannotInstall, match="no wheel"), store.open_environment(wish("1.0")):
        pass
    assert [file.name for file in store.folder.iterdir() if file.is_dir()] == []


def test_those_that_were_not_used_for_longest_make_room_and_those_in_use_stay(store: EnvironmentStore) -> None:
    for k in range(4):
        with store.open_environment(wish(f"1.{k}")) as environment:
            os.utime(environment.folder / WHOLE, (k, k))
    size = store.compute_size() / 4
    store.limit = 2.5 * size
    with store.open_environment(wish("1.1")) as oldest:  # used now: it is the newest, and locked
        os.utime(oldest.folder / WHOLE, (0, 0))
        made = threading.Thread(target=lambda: use(store, "1.4"))
        made.start()
        made.join()
        assert oldest.folder.is_dir()
    left = {folder.name for _, _, folder in store.list_environments()}
    assert left == {wish(f"1.{k}").compute_key(store.installer) for k in (1, 3, 4)}
    assert len(store.removed) == 2


def use(store: EnvironmentStore, version: str) -> None:
    with store.open_environment(wish(version)):
        pass


def test_two_who_want_the_same_one_make_it_once(store: EnvironmentStore) -> None:
    others = [threading.Thread(target=use, args=(store, "1.0")) for _ in range(3)]
    for one in others:
        one.start()
    for one in others:
        one.join()
    assert (store.made, store.reused) == (1, 2)


def test_a_disk_that_is_full_is_said_before_anything_is_made(
    store: EnvironmentStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(store.folder.parent)._replace(free=10**7)
    monkeypatch.setattr(environments.shutil, "disk_usage", lambda _: full)
    with pytest.raises(InstallerError, match=r"has 0\.01 GB left, an environment may take 0\.5 GB"):
        use(store, "1.0")


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, store: EnvironmentStore) -> None:
    (tmp_path / "file").touch()
    store.folder = tmp_path / "file" / "store"
    with pytest.raises(InputError, match="cannot be written to"):
        use(store, "1.0")


def test_what_takes_room_is_counted_once(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 1000)
    os.link(tmp_path / "a", tmp_path / "b")
    assert compute_folder_size(tmp_path) == 1000


def test_the_folder_of_the_store_can_be_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CROSSCHECK_ENVIRONMENTS", str(tmp_path))
    assert find_store_folder() == tmp_path
    monkeypatch.delenv("CROSSCHECK_ENVIRONMENTS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_store_folder() == tmp_path / "crosscheck" / "environments"


@pytest.mark.parametrize(
    ("errors", "about_release", "words"),
    [
        ("ERROR: No matching distribution found for ball==9", True, "No matching distribution found"),
        ("ERROR: ResolutionImpossible: for help", True, "ResolutionImpossible"),
        ("× No solution found when resolving dependencies:", True, "No solution found"),
        (
            "WARNING: Retrying after connection broken by 'NewConnectionError'\nERROR: No matching distribution found for ball",
            False,
            "the index cannot be reached",
        ),
        ("error: Request failed\nCaused by: dns error: failed to lookup", False, "what was found is kept"),
        (
            "ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device",
            False,
            "no space is left",
        ),
        ("Segmentation fault", False, "Segmentation fault"),
    ],
)
def test_failures_of_installers_are_told_apart(errors: str, about_release: bool, words: str) -> None:
    answer = ProgramAnswer(1, "", errors)
    assert answer.is_about_release == about_release
    assert words in answer.describe("ball cannot be had")


def test_messages_hide_passwords() -> None:
    answer = ProgramAnswer(1, "", "ERROR: https://me:secret@example.org/simple is not there")
    assert "secret" not in answer.describe("x")
    assert "secret" not in Index("https://me:secret@example.org/simple").place


def test_scripts_and_installers_get_what_they_need_and_no_tokens(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {"AWS_SECRET": "a", "PIP_INDEX_URL": "b", "https_proxy": "c", "LC_ALL": "C", "MINE": "d", "PYTHONPATH": "e"}
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    assert given.keys() & make_script_environment().keys() == {"LC_ALL"}
    assert given.keys() & make_script_environment(["MINE"]).keys() == {"LC_ALL", "MINE"}
    assert given.keys() & make_installer_environment().keys() == {"LC_ALL", "PIP_INDEX_URL", "https_proxy"}


def test_uv_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    with pytest.raises(InstallerError, match="uv is not installed; write python -m pip install uv"):
        choose_installer("uv", Index(), False)
    assert choose_installer("auto", Index(), False).name == "pip"


def test_uv_gets_the_index_of_the_user() -> None:
    made = make_uv_settings(Index("https://a.org/simple", ("https://b.org/simple",), ("/links",)))
    assert (made["UV_DEFAULT_INDEX"], made["UV_INDEX"], made["UV_FIND_LINKS"]) == (
        "https://a.org/simple", "https://b.org/simple", "/links",
    )  # fmt: skip


def test_pins_are_read_in_the_forms_of_both_installers() -> None:
    text = "ball==1.0 --hash=sha256:00\nOther_Name==2 \\\n    --hash=sha256:11 \\\n    --hash=sha256:22\n# ball==3\n"
    assert read_pins(text) == {"ball": "1.0", "other-name": "2"}
