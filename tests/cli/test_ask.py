"""``wt ask`` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.ask.conftest import XML
from wt.ask.robot import SimulatedRobot
from wt.cli.main import main
from wt.data import recording as recordings
from wt.types import Recording

RATE = 100.0


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """An arm, and a machine whose drive adds .5 N·m."""
    (tmp_path / "arm.xml").write_text(XML)
    servo = '<position name="a" joint="j" kp="40" kv="2"/>'
    biased = '<general name="a" joint="j" biastype="affine" gainprm="40" biasprm=".5 -40 -2"/>'
    (tmp_path / "world.xml").write_text(XML.replace(servo, biased))
    return tmp_path


def recorded(place: Path) -> Path:
    """Six slow seconds at angles where gravity pulls one way."""
    t = np.arange(0.0, 6.0, 1.0 / RATE)
    u = 0.3 * np.sin(1.3 * t) + 0.2 * np.sin(3.1 * t)
    commands = Recording(t, {"ctrl/a": u, "qpos/j": np.zeros_like(u)})
    path = place / "slow.parquet"
    recordings.write(SimulatedRobot(place / "world.xml", 1e-4, 0).perform(0, commands), path)
    return path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--robot", "simm"], "did you mean 'sim'?"),
        (["--robot", "sim"], "--robot sim and --world WORLD.xml go together"),
        (["--world", "world.xml"], "--robot sim and --world WORLD.xml go together"),
        (["--seconds", "5"], "at least 10 s"),
        (["--precision", "10"], "between 0 and 1"),
    ],
)
def test_what_cannot_be_asked_is_one_line(
    words: list[str], said: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ask", str(place / "arm.xml"), "--out", str(place / "out"), *words]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not (place / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<position name="a" joint="j" kp="40" kv="2"/>', "", "nothing drives this machine"),
        ('<joint name="j"', '<freejoint name="free"/></body><body><joint name="j"', "base is free"),
    ],
)
def test_a_machine_that_cannot_be_asked(
    old: str, new: str, said: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = place / "arm.xml"
    model.write_text(
        XML.replace(old, new).replace("</body><body>", "<geom size='.1'/></body><body>")
    )
    assert main(["ask", str(model), "--out", str(place / "out")]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.long
def test_asking_settles_what_a_recording_left_open(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["ask", str(place / "arm.xml"), str(recorded(place)), "--out", str(place / "out")]
    sim = ["--robot", "sim", "--world", str(place / "world.xml"), "--whole-range", "--most", "1"]
    assert main([*words, *sim, "--seconds", "12"]) == 0
    out = capsys.readouterr().out
    assert "It may as well be: " in out and "actuator.deadband at actuator a" in out
    said = json.loads((place / "out" / "asked.json").read_text())
    first, last = said["rounds"]
    assert first["rivals"] and not last["rivals"] and not said["open"]
    assert said["stopped"] == "no other name fits"
    found = json.loads((place / "out" / "diagnosis" / "diagnosis.json").read_text())
    assert [f["effect"] for f in found["findings"]] == ["actuator.bias"]
    assert found["findings"][0]["parameters"]["torque"]["value"] == pytest.approx(0.5, abs=0.02)
    commands = recordings.read(place / "out" / "experiment_1.parquet")
    assert commands.meta["source"] == "wt ask" and (place / "out" / "recorded_1.parquet").exists()
