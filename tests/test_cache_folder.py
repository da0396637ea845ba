"""Where caches go, and which folders are private enough to run code from."""

from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_planner.cache_folder import UnusableFolderError, cache_folder, check_private, temporary_cache_folder


@pytest.fixture(autouse=True)
def no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("TDCR_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)


def test_the_given_folder_comes_before_the_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    assert cache_folder() == tmp_path / ".cache" / "tdcr_planner"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "tdcr_planner"
    monkeypatch.setenv("TDCR_CACHE_DIR", str(tmp_path / "given"))
    assert cache_folder() == tmp_path / "given"


def test_a_home_that_cannot_be_told_is_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr("pathlib.Path.home", no_home)
    assert cache_folder() is None


def test_a_folder_is_made_for_its_user_alone(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    check_private(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    check_private(folder)


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777])
def test_a_folder_that_others_can_write_to_is_refused(tmp_path: Path, mode: int) -> None:
    tmp_path.chmod(mode)
    with pytest.raises(UnusableFolderError, match="other users can write to it"):
        check_private(tmp_path)


def test_a_file_or_a_link_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UnusableFolderError, match="cannot be made"):
        check_private(tmp_path / "file")
    with pytest.raises(UnusableFolderError, match="cannot be made"):
        check_private(tmp_path / "file" / "inside")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    with pytest.raises(UnusableFolderError, match="is a link"):
        check_private(tmp_path / "link")


def test_each_user_has_another_temporary_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1)
    first = temporary_cache_folder()
    monkeypatch.setattr("os.geteuid", lambda: 2)
    assert temporary_cache_folder() != first
