"""From files to checks, maps and curves, by the requests that the page makes."""

from __future__ import annotations

import io
import re
import shlex
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.studio.conftest import TOKEN, Studio
from wt.cli.main import main
from wt.data import recording as recordings
from wt.types import Recording


@pytest.fixture
def faulty(cart: Path, tmp_path: Path) -> Path:
    """The first recording of the cart with its command reversed and its velocity in mm/s."""
    given = recordings.read(cart / "1.parquet")
    columns = dict(given.columns)
    columns["ctrl/drive"] = -columns["ctrl/drive"]
    columns["qvel/rail"] = 1e3 * columns["qvel/rail"]
    path = tmp_path / "faulty.parquet"
    recordings.write(Recording(given.t, columns), path)
    return path


def fields(**changed: str) -> dict[str, str]:
    """The form of a cart's recording: ctrl/drive, qpos/rail, qvel/rail."""
    form = {"log": "logs/faulty.parquet"}
    for i, channel in enumerate(("ctrl/drive", "qpos/rail", "qvel/rail")):
        form |= {f"channel.{i}": channel, f"unit.{i}": "SI", f"factor.{i}": "1", f"offset.{i}": "0"}
    return form | {name.replace("_", "."): value for name, value in changed.items()}


def paths(html: str) -> list[str]:
    """The curves of all charts."""
    return re.findall(r'<path class="line \w+" d="([^"]+)"', html)


def test_a_fault_is_found_mapped_and_gone(studio: Studio, cart: Path, faulty: Path) -> None:
    studio.drop(cart / "model.xml")
    studio.drop(faulty)
    assert "checking" in studio.post("check").lower()
    job = studio.ended("check")
    assert job.state == "done", job.line
    assert {f["kind"] for f in job.result["findings"]}
    page = studio.get("live/check")
    assert "found</span>" in page and 'name="reversed.0"' in page

    filled = studio.get("mapping?log=logs/faulty.parquet&fixes=true")
    # with a servo, a command and an encoder that are the wrong way round look the same
    assert 'name="reversed.1" id="reversed-1" checked' in filled
    assert re.search(r'name="factor.2"[^>]* value="-0.000999\d*"', filled)
    before = paths(studio.post("curves", **fields()))
    assert len(before) == 5
    after = paths(studio.post("curves", **fields(reversed_0="on", unit_2="mm")))
    assert len(after) == 5 and after != before
    assert list((studio.session.folder / "maps").iterdir()) == []

    studio.post("mapping", **fields(reversed_0="on", unit_2="mm"))
    result = studio.ended("check").result
    assert result["errors"] == [] and not [f for f in result["findings"] if f["sure"]]
    mapping = yaml.safe_load((studio.session.folder / "maps/faulty.parquet.yaml").read_text())
    assert mapping == {"units": {"qvel/rail": "mm"}, "signs": {"ctrl/drive": -1}}
    made = recordings.read(studio.session.folder / "recordings/faulty.parquet")
    given = recordings.read(cart / "1.parquet")
    np.testing.assert_allclose(made.columns["qvel/rail"], given.columns["qvel/rail"])
    np.testing.assert_array_equal(made.columns["ctrl/drive"], given.columns["ctrl/drive"])
    assert 'name="reversed.0" id="reversed-0" checked' in studio.get("live/check")


def test_the_commands_that_the_page_prints_do_the_same(
    studio: Studio, cart: Path, faulty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    studio.drop(cart / "model.xml")
    studio.drop(faulty)
    studio.post("mapping", **fields(reversed_0="on", unit_2="mm"))
    studio.ended("check")
    folder = studio.session.folder
    made = (folder / "recordings/faulty.parquet", folder / "check/check.html")
    first = [path.read_bytes() for path in made]
    lines = studio.session.checking()
    assert all(line in studio.get("live/check") for line in lines)
    monkeypatch.chdir(folder)
    for line in lines:
        assert main(shlex.split(line)[1:]) == 0
    assert [path.read_bytes() for path in made] == first


def table(cart: Path, path: Path) -> Recording:
    """Write a recording as a table of other names, commands in mm."""
    given = recordings.read(cart / "1.parquet")
    rows = zip(given.t, given.columns["ctrl/drive"], given.columns["qpos/rail"], strict=True)
    text = "".join(f"{t:.6f},{1e3 * u:.9g},{q:.9g}\n" for t, u, q in rows)
    path.write_text("time,target,where\n" + text)
    return given


def test_a_table_is_mapped_by_its_header(studio: Studio, cart: Path, tmp_path: Path) -> None:
    given = table(cart, tmp_path / "log.csv")
    studio.drop(cart / "model.xml")
    studio.drop(tmp_path / "log.csv")
    studio.post("check")
    assert studio.ended("check").result["errors"] == []
    page = studio.get("live/check")
    assert "This log needs a map" in page and '<option value="t" selected>t (time)' in page
    guess = "wt import logs/log.csv --guess --model model/model.xml --to maps/log.csv.yaml"
    assert guess in page and "--map" not in page and "Waits for the map of log.csv" in page
    form = fields(log="logs/log.csv", channel_0="t", channel_1="ctrl/drive", unit_1="mm",
                  channel_2="qpos/rail")  # fmt: skip
    assert len(paths(studio.post("curves", **form))) == 3
    twice = studio.post("curves", **form | {"channel.1": "qpos/rail"})
    assert "are both to be qpos/rail" in twice
    assert "no column is the time" in studio.post("mapping", **form | {"channel.0": ""})
    studio.post("mapping", **form)
    assert studio.ended("check").result["checked"] == ["recordings/log.csv.parquet"]
    made = recordings.read(studio.session.folder / "recordings/log.csv.parquet")
    np.testing.assert_allclose(made.columns["ctrl/drive"], given.columns["ctrl/drive"], atol=1e-8)


def test_a_log_that_waits_for_its_map_is_not_forgotten(
    studio: Studio, cart: Path, tmp_path: Path
) -> None:
    table(cart, tmp_path / "log.csv")
    for path in (cart / "model.xml", cart / "1.parquet", tmp_path / "log.csv"):
        studio.drop(path)
    studio.post("check")
    assert studio.ended("check").result["checked"] == ["logs/1.parquet"]
    page = studio.get("live/check")
    assert "Nothing is wrong with what can be read" in page
    assert "Waits for the map of log.csv" in page and "This log needs a map" in page


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"factor_1": "many"}, "the factor of &#39;qpos/rail&#39; is &#39;many&#39;"),
        ({"factor_1": "0"}, "give a number"),
        ({"offset_1": "nan"}, "give a number"),
        ({"unit_1": "furlong"}, "no channel or unit"),
        ({"channel_1": "qpos/nowhere"}, "names nothing in the model"),
        ({"channel_1": "where"}, "give a column of a recording"),
    ],
)
def test_a_map_that_does_not_fit_is_a_line(
    studio: Studio, cart: Path, changed: dict[str, str], said: str
) -> None:
    studio.drop(cart / "model.xml")
    studio.drop(cart / "1.parquet", "faulty.parquet")
    assert said in studio.post("curves", **fields(**changed))


def test_only_what_was_dropped_is_touched(studio: Studio, cart: Path) -> None:
    studio.drop(cart / "1.parquet")
    for path, form in (
        ("remove", {"name": "session.json"}),
        ("remove", {"name": "logs/../session.json"}),
        ("model", {"model": "../model.xml"}),
        ("curves", fields(log="logs/../../secret.parquet")),
    ):
        answer = studio.browser.post(f"/{TOKEN}/{path}", data=form)
        assert answer.status_code == 400 and "\n" not in answer.text
    for name in ("session.json", "logs/1.parquet", "..%2fa.html", "check/check.html"):
        assert studio.browser.get(f"/{TOKEN}/out/{name}").status_code in (400, 404)
    studio.post("remove", name="logs/1.parquet")
    assert studio.session.logs() == []


def test_reports_may_ask_nobody_and_the_folder_comes_as_one(studio: Studio, cart: Path) -> None:
    studio.drop(cart / "model.xml")
    studio.post("check")
    studio.ended("check")
    answer = studio.browser.get(f"/{TOKEN}/out/check/check.html")
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts; default-src 'none'")
    assert "allow-same-origin" not in policy
    content = studio.browser.get(f"/{TOKEN}/download").content
    names = zipfile.ZipFile(io.BytesIO(content)).namelist()
    assert set(names) >= {"session/model/model.xml", "session/check/check.html"}


def test_a_name_with_markup_is_text(studio: Studio, cart: Path) -> None:
    studio.drop(cart / "1.parquet", "%26lt;b%20onload='x()'&.parquet")
    studio.post("check")
    page = studio.get("")
    assert "<b onload" not in page and "&amp;" in page


def test_a_model_with_an_include_and_a_mesh_comes_as_an_archive(
    studio: Studio, tmp_path: Path
) -> None:
    parts = {
        "arm/a_robot.xml": '<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><body>'
        '<joint name="j"/><geom type="mesh" mesh="m" mass="1"/></body></worldbody></mujoco>',
        "arm/scene.xml": '<mujoco><compiler meshdir="meshes"/>'
        '<include file="a_robot.xml"/></mujoco>',
        "arm/meshes/m.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    }
    with zipfile.ZipFile(tmp_path / "arm.zip", "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    assert studio.drop(tmp_path / "arm.zip").startswith("200")
    assert studio.session.model() == "model/arm/scene.xml"
    assert studio.session.assets() == ["model/arm/meshes/m.obj"]
    studio.post("check")
    result = studio.ended("check").result
    assert result["errors"] == [] and "qpos/j" in result["channels"]
    studio.post("model", model="model/arm/a_robot.xml")
    (line,) = studio.ended("check").result["errors"]  # its meshes are where the scene says
    assert "model/arm/a_robot.xml" in line
