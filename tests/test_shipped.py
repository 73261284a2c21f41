"""Configurations and examples come with the package, and have a name without a path."""

from __future__ import annotations

import shutil
from importlib import metadata
from pathlib import Path, PurePosixPath

import pytest

from wt import shipped
from wt.config import load
from wt.errors import ConfigError


def test_a_bare_name_is_a_configuration_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("r5", "r5.yaml"):
        assert load(Path(name), []).registry_name == "wt-r5"


def test_a_file_of_the_users_wins_over_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r5.yaml").write_text("base: 5\n")
    assert shipped.configuration(Path("r5.yaml")) == Path("r5.yaml")
    missing = Path("here/r5.yaml")
    assert shipped.configuration(missing) == missing


def test_a_misspelt_name_is_told_the_nearest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="did you mean 'go2_flat'"):
        load(Path("go2_flatt"), [])


def test_an_installed_wheel_has_them_under_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    conf = tmp_path / "share" / "world-translation" / "conf"
    shutil.copytree(shipped.folder("conf"), conf)

    class Installed(PurePosixPath):
        def locate(self) -> Path:
            return tmp_path / "lib" / self

    files = [Installed("wt/fit.py"), Installed("../share/world-translation/conf/base.yaml")]
    monkeypatch.setattr(shipped, "_CHECKOUT", tmp_path / "lib")
    monkeypatch.setattr(metadata, "files", lambda _: files)
    assert shipped.folder("conf") == conf
    assert not shipped.folder("examples").exists()
