"""What may come in: plain names, up to the limit, and no archive that leads out or swells."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import pytest

from tests.studio.conftest import TOKEN, Studio
from wt.errors import UserError
from wt.studio import uploads
from wt.studio.uploads import MB


def packed(files: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


@pytest.mark.parametrize(
    "name",
    ["../a.xml", "/etc/passwd", "a/../../b", "a//b", "", ".bashrc", "a/.ssh/b", "a\\b", "a\x00b",
     "C:\\x", "a\nb", "/".join("abcdefghi"), "x" * 200],
)  # fmt: skip
def test_names_that_are_not_plain(name: str) -> None:
    with pytest.raises(UserError) as error:
        uploads.place(name)
    assert "\n" not in str(error.value)


def test_a_model_and_what_it_includes_go_together() -> None:
    assert str(uploads.place("arm/arm.XML")) == "model/arm/arm.XML"
    assert str(uploads.place("arm/meshes/link 1.stl")) == "model/arm/meshes/link 1.stl"
    assert str(uploads.place("Läufe/1.parquet")) == "logs/Läufe/1.parquet"


def test_a_traversal_in_the_address_writes_nothing(studio: Studio, tmp_path: Path) -> None:
    for name in ("%2e%2e/%2e%2e/a.xml", "..%2f..%2fa.xml", "%2fa.xml"):
        answer = studio.browser.put(f"/{TOKEN}/files/{name}", content=b"<mujoco/>")
        assert answer.status_code in (400, 403, 404)
    assert not list(tmp_path.rglob("*.xml"))


def test_what_is_there_stays(studio: Studio, cart: Path) -> None:
    assert studio.drop(cart / "model.xml").startswith("200")
    assert "is there already" in studio.drop(cart / "1.parquet", "model.xml")
    assert (studio.session.folder / "model/model.xml").read_bytes().startswith(b"<mujoco")


def test_the_limit_holds_whatever_the_header_says(studio: Studio) -> None:
    def endless() -> object:
        for _ in range(100):
            yield b"0" * MB

    address = f"/{TOKEN}/files/big.csv"
    told = studio.browser.put(address, content=b"0" * (2 * MB + 1))
    streamed = studio.browser.put(address, content=endless())  # type: ignore[arg-type]
    for answer in (told, streamed):
        assert answer.status_code == 400
        assert "'big.csv' is larger than 2 MB" in answer.text and "--limit-mb" in answer.text
    assert list((studio.session.folder / "logs").iterdir()) == []


def test_an_archive_with_a_model_and_one_with_logs(tmp_path: Path) -> None:
    archive = tmp_path / "arm.zip"
    archive.write_bytes(packed({"arm/a.stl": b"", "arm/arm.xml": b"<m/>", "__MACOSX/x": b""}))
    names = uploads.unpack(archive, tmp_path, MB)
    assert names == ["model/arm/a.stl", "model/arm/arm.xml"] and not archive.exists()
    archive = tmp_path / "bag.zip"
    archive.write_bytes(packed({"metadata.yaml": b"a", "b.db3": b"b"}))
    assert uploads.unpack(archive, tmp_path, MB) == ["logs/bag/metadata.yaml", "logs/bag/b.db3"]


@pytest.mark.parametrize("name", ["../a.xml", "/a.xml", "a/../../b.xml", "a\\..\\..\\b.xml"])
def test_an_archive_that_leads_out(tmp_path: Path, name: str) -> None:
    refused(tmp_path, packed({name: b"x", "b.xml": b"x"}), "no plain file name")


def test_an_archive_that_swells(tmp_path: Path) -> None:
    refused(tmp_path, packed({"a.xml": b"0" * (3 * MB)}), "larger than 2 MB")
    content = packed({"a.xml": b"0" * (3 * MB)})
    lying = content.replace((3 * MB).to_bytes(4, "little"), (100).to_bytes(4, "little"))
    assert lying != content
    refused(tmp_path, lying, "larger than 2 MB|cannot be unpacked")
    refused(tmp_path, packed({f"{i}.xml": b"" for i in range(5001)}), "5001 files")


def test_an_archive_with_a_link_or_broken(tmp_path: Path) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        link = zipfile.ZipInfo("a.xml")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, "/etc/passwd")
    refused(tmp_path, content.getvalue(), "holds a link")
    refused(tmp_path, packed({"a.xml": b"x" * 999})[:-40], "cannot be unpacked")


def refused(folder: Path, content: bytes, said: str) -> None:
    """See an archive refused, and nothing left of it."""
    (folder / "in").mkdir(exist_ok=True)
    (folder / "in" / "a.zip").write_bytes(content)
    with pytest.raises(UserError, match=said) as error:
        uploads.unpack(folder / "in" / "a.zip", folder / "in", 2 * MB)
    assert "\n" not in str(error.value)
    assert not [p for p in folder.rglob("*") if p.is_file()]
