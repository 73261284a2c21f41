"""The registry of importers: found by themselves, one name each, clear words for the rest."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pytest

from wt.data.importers import base
from wt.errors import DataError


def test_every_file_of_the_package_is_found() -> None:
    files = {p.stem for p in Path(base.__file__).parent.glob("[!_]*.py")} - {"base"}
    assert set(base.importers()) == files


@pytest.mark.parametrize("name", sorted(base.importers()))
def test_contract(name: str, tmp_path: Path) -> None:
    importer = base.importers()[name]
    assert importer.name == name
    assert importer.about
    assert not importer.recognises(tmp_path / "missing")
    assert not importer.recognises(tmp_path)
    (tmp_path / "noise.bin").write_bytes(b"\x00\xff\x13")
    assert not importer.recognises(tmp_path / "noise.bin")


def test_a_name_used_twice_is_refused() -> None:
    class Second:
        name: ClassVar[str] = "csv_table"
        about: ClassVar[str] = ""
        keys: ClassVar[frozenset[str]] = frozenset()
        general: ClassVar[bool] = False

    base.importers()
    with pytest.raises(DataError, match=r"csv_table.*test_base"):
        base.register(Second)  # type: ignore[arg-type]


def test_sources_nobody_reads(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        base.read(tmp_path / "missing")
    with pytest.raises(DataError, match=r"no known format.*control\.csv"):
        base.read(tmp_path)


def test_maps_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        base.read_map(tmp_path / "missing.yaml")
    (tmp_path / "list.yaml").write_text("- a\n- b\n")
    with pytest.raises(DataError, match="holds list"):
        base.read_map(tmp_path / "list.yaml")
