"""The command that README opens with, typed in a fresh clone: what it prints, and what it leaves.

``stranger.sh`` does more, and takes minutes.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import pytest

from tests.browser import CUT, watched
from tests.end_to_end.conftest import Tried

if TYPE_CHECKING:
    from playwright.sync_api import Browser


_FIGURE = r"\d+(?:\.\d+)?"


def words(text: str) -> list[str]:
    """The words of a text, without its figures."""
    return re.sub(_FIGURE, "#", re.sub("─+", "", text)).split()


def test_it_prints_what_readme_says(tried: Tried) -> None:
    assert words(tried.printed) == words(tried.promised)
    # the last digit may be another on another machine
    printed, promised = (
        [float(x) for x in re.findall(_FIGURE, text)] for text in (tried.printed, tried.promised)
    )
    assert printed == pytest.approx(promised, rel=0.02)


def test_it_finds_what_is_hidden(tried: Tried) -> None:
    answer = tried.clone / "examples" / "arm" / "answer.json"
    (hidden,) = json.loads(answer.read_text())["truth"]
    (said,) = tried.found["findings"]  # type: ignore[misc]
    assert tried.found["verdict"] == "explained"
    assert (said["effect"], said["at"]) == (hidden["effect"], hidden["at"])
    for parameter, truth in hidden["parameters"].items():
        low, high = said["parameters"][parameter]["ci95"]
        assert low < truth < high


def test_plain_mujoco_loads_the_patched_model(tried: Tried) -> None:
    mujoco.MjModel.from_xml_path(str(tried.clone / "diagnosis" / "model.xml"))


def test_rerun_reads_the_recording(tried: Tried) -> None:
    rerun = Path(sys.executable).parent / "rerun"
    recording = tried.clone / "diagnosis" / "diagnosis.rrd"
    subprocess.run([rerun, "rrd", "verify", recording], check=True, capture_output=True)


@pytest.mark.parametrize("width", [1400, 400])
def test_a_browser_shows_the_report_and_nothing_beside_the_page(
    tried: Tried, browser: Browser, width: int
) -> None:
    report = (tried.clone / "diagnosis" / "report.html").as_uri()
    with watched(browser.new_page(viewport={"width": width, "height": 800}), report) as page:
        page.goto(report)
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert page.evaluate(CUT) == []
