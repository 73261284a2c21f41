"""Every page in a browser, on a screen and on a phone: nothing is cut, faint or asked for."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pytest

from tests.browser import CONTRAST, CUT, LEAST, NAMELESS, watched
from tests.diagnose import synthetic
from tests.passport.passports import addition, estimates
from tests.prove.test_page import scored
from wt.ask import plan_page
from wt.ask.measured import Measured
from wt.ask.plan import Apart, Cause, Plan
from wt.check.files import Audited
from wt.check.finding import AuditFinding
from wt.check.page import page as check_page
from wt.data import recording as recordings
from wt.diagnose.report.page import report
from wt.diagnose.result import Diagnosis, Used
from wt.passport.card import card
from wt.passport.folder import Passport
from wt.passport.page import page as passport_page
from wt.prove.page import page as prove_page
from wt.types import Location

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Scheme = Literal["light", "dark"]
FAR = "recordings/of/a/machine/2026-11-25_shaken_by_hand_with_the_gripper_closed.parquet"
LONG = "left_shoulder_pitch_joint"
HEADINGS = "[...document.querySelectorAll('h1, h2, h3')].map(h => Number(h.tagName[1]))"


def several(folder: Path) -> Diagnosis:
    """Many findings at a joint with a long name, of recordings with long ones."""
    path = synthetic.write_model(folder)
    path.write_text(path.read_text().replace("j2", LONG))
    full = synthetic.diagnosis(str(path))
    at = Location("joint", LONG)
    names = ("joint.friction_directional", "joint.backlash", "joint.elasticity", "joint.stop")
    found = [dataclasses.replace(full.findings[0], effect=name, at=at) for name in names]
    joints = ("j1", LONG)
    errors = dict(zip(joints, full.proof.joints.values(), strict=True))
    traces = [dataclasses.replace(t, name=FAR, before=30.0 * t.before) for t in full.traces]
    ahead = {0.1: (1.2e-4, 3e-5), 0.5: (3e-4, 1e-5), 2.0: (2.1e-3, 1e-5)}
    return dataclasses.replace(
        full,
        joints=joints,
        findings=tuple(found),
        locations=(dataclasses.replace(full.locations[0], at=at),),
        recordings=(Used(FAR, "fit", 10.0, 100.0),),
        traces=tuple(traces),
        proof=dataclasses.replace(full.proof, joints=errors, horizons={"rad": ahead}),
    )


def checked(root: Path) -> str:
    cart = root / "examples" / "cart"
    given = recordings.read(cart / "1.parquet")
    finding = AuditFinding("command_sign", ("ctrl/drive",), (), "Long evidence " * 9, "a: fix " * 9)
    return check_page(cart / "model.xml", [Audited(Path(FAR), given, given, (finding,))])


def planned() -> str:
    causes = [Cause(f"joint.friction_{i}", Location("joint", LONG)) for i in range(26)]
    pairs = [
        Apart((a, b), 1.0 + i, "swings at many frequencies")
        for i, a in enumerate(causes)
        for b in causes[:i]
    ]
    sensors = Measured(
        declared=True, joints=(LONG,), speeds=(), drives=(), bodies=(), others=(f"{LONG}_touch",)
    )
    unseen = (Cause("joint.armature", Location("joint", LONG)),)
    plan = Plan({LONG: tuple(pairs)}, ("joint.backlash",), sensors, unseen)
    return plan_page.page(plan, "arm.xml")


@pytest.fixture(scope="module")
def pages(root: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One of each kind, as files."""
    model = tmp_path_factory.mktemp("model")
    passport = Passport((addition(estimates()),))
    of = card(passport.rows)
    made = {
        "report": report(several(tmp_path_factory.mktemp("several"))),
        "nothing": report(synthetic.nothing(str(synthetic.write_model(model)))),
        "unknown": report(synthetic.unexplained(str(synthetic.write_model(model)))),
        "check": checked(root),
        "trial": prove_page(scored()),
        "plan": planned(),
        "passport": passport_page(passport, of, passport.units, "robot"),
    }
    folder = tmp_path_factory.mktemp("pages")
    paths = {name: folder / f"{name}.html" for name in made}
    for name, path in paths.items():
        path.write_text(made[name], encoding="utf-8")
    return paths


NAMES = ("report", "nothing", "unknown", "check", "trial", "plan", "passport")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("width", "scheme"), [(1400, "dark"), (400, "light"), (400, "dark")])
def test_everything_is_seen(
    browser: Browser, pages: dict[str, Path], name: str, width: int, scheme: Scheme
) -> None:
    opened = browser.new_page(color_scheme=scheme, viewport={"width": width, "height": 900})
    with watched(opened, "file://") as page:
        page.goto(pages[name].as_uri())
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert page.evaluate(CUT) == []
        assert page.evaluate(LEAST) > 10.0
        assert not [each for each in page.evaluate(CONTRAST) if each[0] < 4.5]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_can_be_heard(browser: Browser, pages: dict[str, Path], name: str) -> None:
    with watched(browser.new_page(), "file://") as page:
        page.goto(pages[name].as_uri())
        assert page.evaluate("document.documentElement.lang") == "en"
        assert len(page.title()) > len("wt")
        assert page.evaluate(NAMELESS) == []
        levels = page.evaluate(HEADINGS)
        assert levels.count(1) == 1 and levels[0] == 1
        assert all(after <= before + 1 for before, after in itertools.pairwise(levels))


def test_the_keyboard_opens_what_is_closed(browser: Browser, pages: dict[str, Path]) -> None:
    with watched(browser.new_page(), "file://") as page:
        page.goto(pages["report"].as_uri())
        for _ in range(20):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.textContent").startswith("4 decisions"):
                break
        focused = "getComputedStyle(document.activeElement)"
        assert page.evaluate(f"{focused}.outlineStyle") == "solid"
        page.keyboard.press("Enter")
        page.keyboard.press("Tab")
        page.keyboard.type("actuator")
        shown = page.locator("#decisions > details:visible > summary").all_inner_texts()
        assert [text.partition(",")[0] for text in shown] == ["actuator a2"]
