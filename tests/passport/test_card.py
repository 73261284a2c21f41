"""Report cards say what is the matter, in sentences, on one page; nothing of the user's is lost."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.passport.passports import DRIVE, ELBOW, ZERO, addition, estimates
from wt.cli.main import main
from wt.passport.card import card, differences
from wt.passport.folder import append, locked
from wt.passport.parts import parts_of
from wt.passport.text import changed, history, level
from wt.physics.scene import Scene

SENTENCE = "Joint elbow's Coulomb friction rose from 0.2"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    folder = tmp_path / "robot"
    with locked(folder):
        append(folder, addition(estimates()))
    return folder


def test_each_quantity_is_put_where_it_belongs() -> None:
    of = card(estimates())
    assert level(of, DRIVE) == "the unit"
    assert level(of, ZERO) == "nothing that shows"
    assert level(of, ELBOW) == "the model"  # one unit's last session is that unit's matter
    value = of.states["B04"][DRIVE].value
    assert value.low <= 1.0 <= value.high


def test_only_what_changed_raises_an_alarm() -> None:
    of = card(estimates())
    assert [(unit, q) for unit, q, _ in of.alarms] == [("A17", ELBOW)]
    said = changed(ELBOW, of.states["A17"][ELBOW])
    assert re.fullmatch(
        r"Joint elbow's Coulomb friction rose from 0\.2\d* to 0\.3\d* N·m in 12 days\.", said
    )


def test_before_it_changed_nothing_is_said() -> None:
    of = card(estimates(range(4)))
    assert of.alarms == []
    assert of.levels[ELBOW].level == "model"


def test_units_differ_where_they_do() -> None:
    found = differences(card(estimates(range(4))), "A17", "B04")
    assert [d.quantity for d in found if d.sure] == [DRIVE]
    assert found[0].by.low <= 0.1 <= found[0].by.high


def test_a_unit_that_changed_differs_from_the_others_as_it_is() -> None:
    found = differences(card(estimates()), "A17", "B04")
    assert {d.quantity for d in found if d.sure} == {DRIVE, ELBOW}
    (elbow,) = (d for d in found if d.quantity == ELBOW)
    assert elbow.one.low <= 0.34 <= elbow.one.high


def test_what_is_decided_is_json_without_infinities() -> None:
    said = card(estimates()).to_json()
    assert {entry["quantity"]: entry["level"] for entry in said["levels"]} == {
        str(DRIVE): "unit", str(ELBOW): "model", str(ZERO): "model",
    }  # fmt: skip
    (alarm,) = said["alarms"]
    assert alarm["unit"] == "A17"
    assert alarm["days"] == 12.0


def test_show_prints_the_cards_and_writes_the_page(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["passport", "show", str(robot)]) == 0
    out = capsys.readouterr().out
    assert SENTENCE in out
    assert "Nothing on B04 changed significantly" in out
    page = html.unescape((robot / "passport.html").read_text())
    assert SENTENCE in page.replace("\N{NO-BREAK SPACE}", " ")
    assert page.count("<figure>") == 9
    assert not re.search(r'(src|href)="(?!#)', page)
    # an earlier page is ours to replace
    assert main(["passport", "show", str(robot), "--unit", "B04"]) == 0
    assert (robot / "passport.html").read_text().count("<figure>") == 3


def test_the_state_of_every_joint_drive_and_sensor_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(
        "<mujoco><worldbody><body><joint name='elbow'/><geom size='.1' mass='1'/><site name='s'/>"
        "<body><joint name='wrist'/><geom size='.1' mass='1'/></body></body></worldbody>"
        "<actuator><motor name='a1' joint='elbow'/><motor name='a2' joint='wrist'/></actuator>"
        "<sensor><gyro name='imu' site='s'/></sensor></mujoco>"
    )
    folder = tmp_path / "robot"
    with locked(folder):
        append(folder, replace(addition(estimates()), parts=parts_of(Scene(model))))
    assert main(["passport", "show", str(folder), "--unit", "B04"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    # the elbow, the first drive and the wrist's encoder have rows of their own
    others = ("joint wrist", "actuator a2", "encoder of elbow", "sensor imu")
    assert f"As in the model, as far as recordings show: {', '.join(others)}." in out
    page = html.unescape((folder / "passport.html").read_text())
    page = page.replace("\N{NO-BREAK SPACE}", " ")
    assert page.count("as in the model</td>") == 4
    assert all(f">{name}</td>" in page for name in others)


def test_what_varies_is_not_called_unchanged() -> None:
    rng = np.random.default_rng(3)
    rows = [
        replace(r, value=float(rng.normal())) if r.quantity == ZERO else r
        for r in estimates(range(4))
    ]
    of = card(rows)
    assert of.levels[ZERO].level == "session"
    told = history(ZERO, of.states["B04"][ZERO])
    assert told == "Joint wrist's offset: varies as usual."
    assert history(ELBOW, of.states["B04"][ELBOW]).endswith(": unchanged.")


def test_of_first_sessions_nothing_is_said_to_be_unchanged(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    with locked(folder):
        append(folder, addition(estimates(range(1))))
    assert main(["passport", "show", str(folder)]) == 0
    page = (folder / "passport.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    assert "What changes shows from the second session on." in page
    assert "Nothing changed" not in page


def test_a_page_of_somebody_else_is_not_replaced(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (robot / "passport.html").write_text("mine")
    assert main(["passport", "show", str(robot)]) == 2
    assert "no wt passport wrote it" in capsys.readouterr().err
    assert (robot / "passport.html").read_text() == "mine"


def test_figures_go_to_mlflow(
    robot: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mlflow = pytest.importorskip("mlflow")
    store = f"sqlite:///{robot.parent / 'mlflow.db'}"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    assert main(["passport", "show", str(robot), "--track"]) == 0
    run_id = re.search(r"run (\w{32}) in sqlite", capsys.readouterr().out)
    assert run_id
    data = mlflow.MlflowClient(store).get_run(run_id[1]).data
    assert data.metrics["alarms"] == 1
    assert data.metrics[f"A17/{ELBOW}"] == pytest.approx(0.34, abs=0.03)
    assert data.params[f"level/{DRIVE}"] == "unit"


def test_diff_says_what_differs(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["passport", "diff", str(robot), "A17", "B04"]) == 0
    assert "Actuator a1's gain is 0." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["show", "{robot}", "--unit", "A71"], "did you mean 'A17'?"),
        (["show", "{robot}/none"], "holds no passport; make one: wt passport add"),
        (["show", "{robot}", "--limit", "elbow"], "is no QUANTITY=VALUE, as in"),
        (["show", "{robot}", "--limit", "joint.friction_coulomb/elbo/coulomb=1"], "did you mean"),
        (["diff", "{robot}", "A17", "X"], "unit 'X' is not in this passport"),
        (["diff", "{robot}", "A17", "A17"], "are the same unit"),
        (["add", "{robot}/no.xml", "{robot}/no.parquet", "--out", "{robot}"], "does not exist"),
        (["add", "a.xml", "a.parquet", "--out", "{robot}", "--search", "all"], "--search 'all'"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    robot: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["passport", *(a.format(robot=robot) for a in arguments)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_a_fleet_that_lacks_nothing_has_a_passport_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "robot"
    with locked(folder):
        append(folder, replace(addition(estimates()), rows=(), hypothesis=()))
    assert main(["passport", "show", str(folder)]) == 0
    assert "Nothing on A17 changed significantly" in capsys.readouterr().out
    assert main(["passport", "diff", str(folder), "A17", "B04"]) == 0
    assert "no quantity in common" in capsys.readouterr().out
    assert main(["passport", "show", str(folder), "--limit", "x=1"]) == 2
    assert "is not in this passport" in capsys.readouterr().err


def test_a_limit_is_foretold_where_the_trend_is_certain() -> None:
    """The elbow's friction grows by 0.01 N·m a day from 0.2; nothing else does."""
    rows = [
        replace(r, value=0.2 + 0.01 * (r.labels.day - 739920.0), error=1e-3)
        if r.quantity == ELBOW and r.labels.unit == "A17"
        else r
        for r in estimates()
    ]
    of = card(rows, {str(ELBOW): 1.0, str(DRIVE): 2.0})
    state = of.states["A17"][ELBOW]
    last = 0.2 + 0.01 * (max(r.labels.day for r in rows) - 739920.0)
    assert state.reached is not None
    assert state.reached.value == pytest.approx((1.0 - last) / 0.01, rel=1e-3)
    assert "; it reaches 1.00 N·m in " in changed(ELBOW, state)
    # 0.2 N·m on 2026-10-31, and 0.01 more on each of 80 days
    assert ", on 2027-01-19 " in changed(ELBOW, state)
    assert of.states["A17"][DRIVE].reached is None
