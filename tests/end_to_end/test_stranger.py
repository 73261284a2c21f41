"""The command that README opens with, typed in a fresh clone: what it prints, and what it leaves.

``stranger.sh`` does more, and takes minutes.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from tests.end_to_end.conftest import Tried

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def words(text: str) -> list[str]:
    """The words of a text; figures may differ in their last digit from machine to machine."""
    return re.sub(r"[\d.]+", "#", re.sub("─+", "", text)).split()


def test_it_prints_what_readme_says(tried: Tried) -> None:
    assert words(tried.printed) == words(tried.promised)


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
    tried: Tried, width: int, tmp_path: Path
) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"there is no browser: {', '.join(BROWSERS)}")
    report = (tried.clone / "diagnosis" / "report.html").read_text(encoding="utf-8")
    probe = "<script>document.title = document.documentElement.scrollWidth</script></body>"
    page = tmp_path / "page.html"
    page.write_text(report.replace("</body>", probe), encoding="utf-8")
    frame = tmp_path / "frame.html"
    # a window of the browser's own has a least width that is more than a telephone's
    frame.write_text(
        f'<iframe id="f" src="page.html" width="{width}" height="800" style="border:0"></iframe>'
        "<script>f.onload = () => document.body.dataset.is = f.contentDocument.title</script>"
    )
    shown = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
         "--allow-file-access-from-files",
         f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000", "--dump-dom",
         frame.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    ).stdout  # fmt: skip
    needed = re.search(r'data-is="(\d+)"', shown)
    assert needed is not None, shown[-500:]
    assert int(needed[1]) <= width
