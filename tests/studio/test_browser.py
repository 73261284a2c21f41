"""The page in headless Chromium: from files to the report by the keyboard alone, in the dark."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.browser import CONTRAST, CUT, NAMELESS, watched
from wt.data import recording as recordings

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Of a studio that the command serves."""
    command = [sys.executable, "-m", "wt.cli.main", "studio", "--dir", str(tmp_path / "session")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    server = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert server.stdout is not None and server.stderr is not None
    yield server.stdout.readline().strip()
    server.send_signal(signal.SIGINT)
    assert server.wait(20) == 0
    assert server.stderr.read().count("\n") == 1  # where the session is, and no traceback


@pytest.fixture
def page(browser: sync_api.Browser, address: str) -> Iterator[sync_api.Page]:
    """The page in the dark; nothing that it does may fail, or ask anybody else."""
    opened = browser.new_page(color_scheme="dark", viewport={"width": 1400, "height": 900})
    with watched(opened, address.rpartition("/")[0]):
        opened.goto(address)
        yield opened


@pytest.fixture
def files(cart: Path, tmp_path: Path) -> list[Path]:
    """The cart, and four seconds of each recording with the command the wrong way round."""
    made = [cart / "model.xml"]
    for name in ("1.parquet", "2.parquet"):
        r = recordings.read(cart / name)
        early = r.t < r.t[0] + 4.0
        columns = {n: (-c if n == "ctrl/drive" else c)[early] for n, c in r.columns.items()}
        recordings.write(replace(r, t=r.t[early], columns=columns), tmp_path / name)
        made.append(tmp_path / name)
    return made


def tab_to(page: sync_api.Page, selector: str) -> None:
    """Press Tab until an element has the focus, which must be seen there."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if page.evaluate("s => document.activeElement.matches(s)", selector):
            style = "getComputedStyle(document.activeElement)"
            assert page.evaluate(f"{style}.outlineStyle") == "solid", selector
            return
    raise AssertionError(f"the keyboard does not reach {selector}")


def curve(page: sync_api.Page) -> str | None:
    """The replay of the cart."""
    return page.locator('[data-channel="qpos/rail"] path.after').get_attribute("d")


def test_from_drop_to_report_by_keyboard_in_the_dark(
    page: sync_api.Page, files: list[Path], tmp_path: Path
) -> None:
    expect = sync_api.expect
    with page.expect_file_chooser() as chooser:
        tab_to(page, "#choose")
        page.keyboard.press("Enter")
    chooser.value.set_files(files)

    expect(page.locator("#check .verdict")).to_have_text("1 found", timeout=30_000)
    expect(page.locator("#status")).to_have_text("checked")
    wrong = curve(page)
    tab_to(page, "#fixes")
    page.keyboard.press("Enter")
    expect(page.locator("#reversed-1")).to_be_checked()
    expect(page.locator("#mapping-head")).to_be_focused()
    expect(page.locator('[data-channel="qpos/rail"] path.before')).to_have_count(1)
    tab_to(page, "#reversed-1")
    page.keyboard.press("Space")
    tab_to(page, "#offset-1")
    page.keyboard.type("5")
    expect(page.locator("figure.now")).to_have_attribute("data-channel", "qpos/rail")
    page.keyboard.press("Backspace")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Space")
    expect(page.locator("#map.htmx-request")).to_have_count(0)
    expect(page.locator('[data-channel="qpos/rail"] path.after')).not_to_have_attribute("d", wrong)
    tab_to(page, "#keep")
    page.keyboard.press("Enter")
    expect(page.locator("#check .verdict")).to_have_text("clean", timeout=30_000)
    assert (tmp_path / "session/maps/2.parquet.yaml").is_file()

    tab_to(page, "#start")
    page.keyboard.press("Enter")
    expect(page.locator("#diagnosis progress")).to_be_visible()
    expect(page.locator("#start")).to_be_focused()
    watched = page.locator("#diagnosis .watch")
    # which of them is a question of when it looks
    expect(watched).to_contain_text(
        re.compile(r"; now \w+\.\w+ at (joint|actuator) "), timeout=60_000
    )
    expect(watched).to_contain_text("joint.friction_coulomb at joint rail", timeout=60_000)
    expect(page.locator("#report .verdict")).to_have_text("Explained", timeout=60_000)
    expect(page.locator("#status")).to_have_text("the diagnosis is done")
    report = page.frame_locator("#report iframe")
    expect(report.locator("h1")).to_contain_text("model.xml")
    expect(report.locator(".lead")).to_contain_text("Joint rail loses 1.")
    tab_to(page, "#report a[download]")
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert re.fullmatch(r"session\.zip", download.value.suggested_filename)
    assert page.evaluate(NAMELESS) == []
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 27)"
    faint = [each for each in page.evaluate(CONTRAST) if each[0] < 4.5]
    assert not faint
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    assert page.evaluate(CUT) == []


@pytest.mark.long
def test_a_folder_is_dropped_and_fits_a_telephone(
    page: sync_api.Page, cart: Path, tmp_path: Path
) -> None:
    (tmp_path / "cart" / "deep").mkdir(parents=True)
    shutil.copy(cart / "model.xml", tmp_path / "cart")
    shutil.copy(cart / "1.parquet", tmp_path / "cart" / "deep")
    page.set_viewport_size({"width": 400, "height": 800})
    page.emulate_media(color_scheme="light")
    data = {"items": [], "files": [str(tmp_path / "cart")], "dragOperationsMask": 1}
    pointer = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver", "drop"):
        pointer.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 300, "data": data})
    sync_api.expect(page.locator("#map")).to_be_visible(timeout=30_000)
    assert (tmp_path / "session/model/cart/model.xml").is_file()
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    assert page.evaluate(CUT) == []
    assert not [each for each in page.evaluate(CONTRAST) if each[0] < 4.5]
