"""MLflow's own pages of a finished run, looked at in headless Chromium as a person would."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urljoin

import pytest

from tests.end_to_end.conftest import METHODS, Place

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

NOBODY = "mlflow/users/current"
"""What pages ask that want to know who is logged in, where nobody can be."""
ROW_OF = """link => {
  const {top} = link.closest("[style*=top]").style;
  const cells = document.querySelectorAll(".ReactVirtualized__Grid__innerScrollContainer > *");
  return [...cells].filter(cell => cell.style.top === top).map(cell => cell.innerText);
}"""
"""The table of compared metrics is two grids side by side, without rows."""


@pytest.fixture(scope="module")
def server(browser: Browser, place: Place, finished: Path) -> Iterator[str]:
    """What ``mlflow ui`` serves, from a thread of this process, which has imported it already."""
    import uvicorn
    from mlflow.server import handlers
    from mlflow.server.fastapi_app import app
    from mlflow.tracking._model_registry import utils as of_models
    from mlflow.tracking._tracking_service import utils as of_runs

    serving = uvicorn.Server(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=2))
    with pytest.MonkeyPatch.context() as patch, socket.create_server(("127.0.0.1", 0)) as listening:
        # a store that is served becomes that of the whole process: not for other tests
        for name in ("MLFLOW_TRACKING_URI", "MLFLOW_REGISTRY_URI"):
            patch.setenv(name, place.store)
        for where, name in (
            (of_runs, "_tracking_uri"),
            (of_models, "_registry_uri"),
            (handlers, "_tracking_store"),
            (handlers, "_model_registry_store"),
        ):
            patch.setattr(where, name, None)
        artifacts = str(place.home / "mlartifacts")
        handlers.initialize_backend_stores(place.store, place.store, artifacts)
        thread = threading.Thread(target=serving.run, args=([listening],))
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
        serving.should_exit = True
        thread.join()


@pytest.fixture(scope="module")
def opened(browser: Browser, server: str) -> Iterator[tuple[Page, list[str]]]:
    """One window for all pages, which loads MLflow once, and what went wrong in it."""
    wrong: list[str] = []
    page = browser.new_page(viewport={"width": 1600, "height": 1000})
    page.set_default_timeout(20_000)
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.on("request", lambda r: None if r.url.startswith((server, "data:", "blob:")) else
            wrong.append(f"asked {r.url}"))  # fmt: skip
    page.on("response", lambda r: wrong.append(f"{r.status} {r.url}")
            if r.status >= 400 and NOBODY not in r.url else None)  # fmt: skip
    page.goto(f"{server}#/experiments?workflowType=machine_learning")
    yield page, wrong
    page.close()


@pytest.fixture
def page(opened: tuple[Page, list[str]]) -> Iterator[Page]:
    """The window; nothing may fail in it, or ask anybody but the server."""
    window, wrong = opened
    wrong.clear()
    yield window
    assert window.locator("[class*=notification-notice]").count() == 0
    assert not wrong


@pytest.fixture
def runs(server: str, finished: Path) -> str:
    """Address of the experiment's runs."""
    return f"{server}#/experiments/1/runs"


@pytest.fixture
def run(runs: str, finished: Path) -> str:
    """Address of the run's page."""
    return f"{runs}/{(finished / 'mlflow_run_id').read_text()}"


def see(what: Locator) -> None:
    """Wait until something is visible; of several, the first."""
    what.first.wait_for()


def follow(link: Locator) -> None:
    """Go where a link leads; a click is lost where the page is still being laid out."""
    link.page.goto(urljoin(link.page.url, link.first.get_attribute("href")))


def test_the_run_says_what_it_is_from_which_data_and_where_its_model_is(
    page: Page, run: str
) -> None:
    page.goto(run)
    said = page.get_by_text("Single-step prediction on the task r5_force")
    see(said.filter(has_text="one run below this one each"))
    about = page.locator("main")
    for method in METHODS:
        see(about.get_by_role("link", name=f"{method}, seed 0", exact=True))
    for words in ("Finished", "paper.row", "figure 3, r5_force", "task", "commit"):
        see(about.get_by_text(words))
    see(about.get_by_text("wt-debug/1, of the run `WorldTranslationPlus, seed 0`"))

    about.get_by_text("r5_force/sim").first.click()
    data = page.get_by_role("dialog")
    see(data.get_by_text("1500"))
    for column in ("o/qpos/joint1", "a/ctrl/joint6", "s_next/qvel/joint6"):
        see(data.get_by_text(column, exact=True))
    for used in ("r5_force/real", "r5_force/test"):
        see(data.get_by_text(used))
    page.keyboard.press("Escape")


def test_tables_and_figures_are_shown(page: Page, run: str) -> None:
    page.goto(f"{run}/artifacts/single_step.json")
    see(page.get_by_text("View as table"))
    for method in METHODS:
        see(page.get_by_role("cell", name=method, exact=True))
    page.get_by_text("results.md", exact=True).click()
    see(page.get_by_role("listitem").filter(has_text="PairedCeiling: trained on"))


def test_a_run_below_has_the_curve_of_its_training(page: Page, run: str) -> None:
    page.goto(run)
    follow(page.get_by_role("link", name="WorldTranslation, seed 0", exact=True))
    see(page.get_by_text("World Translation, the paper's, unchanged"))
    see(page.get_by_text("figure 3, r5_force"))
    page.get_by_role("tab", name="Model metrics").click()
    page.get_by_placeholder("Search metric charts").fill("val/energy_distance")
    curve = page.locator("path.js-line")
    see(curve)
    assert (curve.first.get_attribute("d") or "").count("L") >= 4
    page.get_by_role("tab", name="System metrics").click()
    see(page.get_by_text("cpu_utilization_percentage"))


def test_the_registered_model_is_described_and_leads_to_its_run(page: Page, server: str) -> None:
    page.goto(f"{server}#/models/wt-debug")
    see(page.get_by_text("World Translation for the task r5_force"))
    see(page.get_by_text("champion"))
    follow(page.get_by_role("link", name="Version 1"))
    see(page.get_by_text("is what versions are compared by").filter(has_text="energy_distance"))
    see(page.get_by_role("row", name="WorldTranslationPlus/mse"))
    page.get_by_text("Inputs (42)").click()
    see(page.get_by_text("o_next_sim/qpos/joint1"))
    see(page.get_by_text("Source Run"))
    version = page.url
    follow(page.get_by_role("link", name="WorldTranslationPlus, seed 0"))
    made_by = page.locator("main")
    for words in ("World Translation, ours", "Finished", "test/mse", "heldout/energy_distance"):
        see(made_by.get_by_text(words))
    see(made_by.get_by_role("link", name="finished"))  # the run above it
    see(made_by.get_by_role("grid").get_by_text("Ready"))
    see(made_by.get_by_text("r5_force/sim"))

    page.goto(version)
    see(page.get_by_text("Source Model"))
    follow(page.locator("a[href*='/models/m-']"))
    see(page.get_by_text("About this logged model"))
    see(page.locator("a[href*='/models/wt-debug/versions/1']"))
    assert page.get_by_text("Not registered").count() == 0
    see(page.get_by_text("held-out transitions (#"))
    see(page.get_by_text("train.steps"))


def test_three_runs_are_compared(page: Page, runs: str, finished: Path) -> None:
    compared = ("WorldTranslationPlus", "DirectPred", "RawSim")
    page.goto(f"{runs}?workflowType=machine_learning")
    whole = page.get_by_role("row").filter(has=page.get_by_role("link", name="finished"))
    whole.get_by_role("button").first.click()
    for method in compared:
        link = page.get_by_role("link", name=f"{method}, seed 0", exact=True)
        page.get_by_role("row").filter(has=link).get_by_role("checkbox").check()
    page.get_by_role("button", name="Compare").click()

    see(page.get_by_text("Comparing 3 Runs from 1 Experiment"))
    see(page.get_by_role("row", name="method"))
    errors = json.loads((finished / "results.json").read_text())["single_step"]
    metric = page.get_by_role("link", name="test/mse", exact=True)
    shown = metric.evaluate(ROW_OF)
    assert shown[0] == "test/mse"
    assert {float(x) for x in shown[1:]} == {round(errors[m]["mse"], 3) for m in compared}
    see(page.locator("text.axis-title", has_text="test/mse"))
