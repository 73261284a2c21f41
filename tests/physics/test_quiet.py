"""Replays that explode say so by NaN alone; outside of replays MuJoCo warns as before."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from tests.physics.arm import ARM, commands, scene
from wt.physics import compiled
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.quiet import quiet
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location

LOG = Path("MUJOCO_LOG.TXT")
MODEL = """<mujoco><worldbody><body>
  <joint name="a"/><geom size="0.1" mass="1"/>
</body></worldbody></mujoco>"""


def explode(threads: int) -> None:
    """Step eight simulations whose velocities MuJoCo calls huge."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    batch = Batch(model, nsim=8, nthread=threads)
    batch.bind("qvel")[:] = 1e200
    batch.step()
    assert batch.warning[:, :, 1].any()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where MuJoCo writes its log


@pytest.mark.parametrize("threads", [1, 4])
def test_nothing_is_printed_or_written_inside(
    threads: int, capfd: pytest.CaptureFixture[str]
) -> None:
    with quiet():
        explode(threads)
    assert not LOG.exists()
    assert capfd.readouterr() == ("", "")


def test_warnings_are_back_after_the_last_left(capfd: pytest.CaptureFixture[str]) -> None:
    first, second = quiet(), quiet()
    # as two threads do it: the first to come leaves first
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    explode(1)
    assert not LOG.exists()
    second.__exit__(None, None, None)
    explode(1)
    assert "QVEL" in LOG.read_text()
    assert "QVEL" in "".join(capfd.readouterr())


def test_warnings_are_back_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), quiet():
        raise ZeroDivisionError
    explode(1)
    assert LOG.exists()


@pytest.mark.parametrize(
    ("name", "theta"),
    [("delay", 0.01), ("offset", 0.1), ("scale", 1.1), ("quantization", 0.01)],
)
def test_no_sensor_makes_something_of_an_explosion(name: str, theta: float, tmp_path: Path) -> None:
    t, held = commands(0.1)
    gain = Planted(effects()["actuator.gain"], Location("actuator", "m1"), np.array([-1e7]))
    sensor = Planted(effects()[f"sensor.{name}"], Location("joint", "j1"), np.array([theta]))
    stretch = Stretch(0, t, held, np.zeros(3), np.zeros(3))
    replay = Replayer(scene(tmp_path, ARM), [stretch]).run([[gain, sensor], [sensor]])
    assert np.isnan(replay.q[0]).all() and np.isfinite(replay.q[1]).all()


def test_a_replay_that_explodes_is_silent(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    t, held = commands(0.1)
    gain = Planted(
        effects()["actuator.gain"], Location(kind="actuator", name="m1"), np.array([-1e7])
    )
    still = np.zeros(3)
    stretch = Stretch(0, t, held, still, still)
    replay = Replayer(scene(tmp_path, ARM), [stretch]).run([[gain], []])
    assert np.isnan(replay.q[0]).all()
    assert np.isfinite(replay.q[1]).all()
    assert not LOG.exists()
    assert capfd.readouterr() == ("", "")


def test_a_model_that_is_hardly_possible_is_silent(tmp_path: Path) -> None:
    doubled = MODEL.replace('<joint name="a"/>', '<joint name="a"/><joint name="b"/>')
    path = tmp_path / "m.xml"
    path.write_text(doubled.replace('mass="1"', 'mass="1e-9"'))
    with pytest.warns(UserWarning, match="singular"):
        hardly = Scene(path)
    stretch = Stretch(0, np.arange(3) * 0.01, np.zeros((3, 0)), np.zeros(2), np.zeros(2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Replayer(hardly, [stretch]).run([[]])


def test_a_replay_is_left_once_it_has_exploded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lasted: list[int] = []
    advance = compiled.advance

    def counted(*given: np.ndarray) -> bool:
        stepped = bool(advance(*given))
        lasted.append(int(np.isfinite(given[-1][:, 0]).sum()))
        return stepped

    monkeypatch.setattr(compiled, "advance", counted)
    t, held = commands(1.0)
    gain = Planted(effects()["actuator.gain"], Location("actuator", "m1"), np.array([-1e7]))
    law = effects()["joint.friction_stribeck"]
    friction = Planted(law, Location("joint", "j1"), np.array([0.2, 0.5, 0.1]))
    replayer = Replayer(scene(tmp_path, ARM), [Stretch(0, t, held, np.zeros(3), np.zeros(3))])
    q = replayer.run([[gain, friction], [friction]]).q
    assert np.isnan(q[0]).all() and np.isfinite(q[1]).all()
    assert lasted[0] < 0.2 / replayer.step and lasted[1] > 0.9 / replayer.step
