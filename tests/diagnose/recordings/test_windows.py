"""Windows of machines that do not forget are as long as replays keep beside the recording."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import Smoothed, smooth
from wt.diagnose.recordings.stretches import (
    WINDOW_S,
    WINDOWS_S,
    forgets,
    longest_window,
    stretches_of,
)
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location, Recording

RATE, STEP, SECONDS, NOISE = 100, 1e-3, 16.0, 1e-4
DAMPING = 0.05


def pendulum(links: int, damping: float) -> str:
    """A free pendulum of one or two links."""
    joint = '<joint name="j{0}" axis="0 1 0" damping="{1}"/>'
    link = '<geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1"/>'
    inner = f'<body pos="0 0 -.5">{joint.format(2, damping)}{link}</body>' if links == 2 else ""
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP}"/><worldbody>'
        f"<body>{joint.format(1, damping)}{link}{inner}</body></worldbody></mujoco>"
    )


def swung(folder: Path, links: int, begin: float, made: float, believed: float) -> Smoothed:
    """A recording of a pendulum that is let go, beside a model of another damping."""
    model = mujoco.MjModel.from_xml_string(pendulum(links, made))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:] = begin
    q = np.zeros((int(SECONDS * RATE), links))
    for row in q:
        row[:] = data.qpos
        mujoco.mj_step(model, data, round(1.0 / RATE / STEP))
    q += NOISE * rng.standard_normal(q.shape)
    columns = {f"qpos/j{i + 1}": q[:, i] for i in range(links)}
    path = folder / "pendulum.xml"
    path.write_text(pendulum(links, believed))
    return smooth(Scene(path), [Part(Recording(np.arange(len(q)) / RATE, columns), 0)])


def test_a_swing_is_followed_for_long(tmp_path: Path) -> None:
    smoothed = swung(tmp_path, 1, 1.0, DAMPING, DAMPING)
    assert not forgets(smoothed, STEP)
    longest = longest_window(smoothed, STEP)
    assert longest == WINDOWS_S[-1]
    pieces = [s for s, _ in stretches_of(smoothed, False, window=longest)]
    assert max(s.t[-1] - s.t[0] for s in pieces) > 0.95 * longest


def test_what_is_missing_must_not_carry_replays_away(tmp_path: Path) -> None:
    smoothed = swung(tmp_path, 1, 1.0, 10 * DAMPING, 0.0)
    viscous = effects()["joint.friction_viscous"]
    found = Planted(viscous, Location("joint", "j1"), np.array([10 * DAMPING]))
    assert longest_window(smoothed, STEP) < longest_window(smoothed, STEP, (found,))


def test_a_chaotic_motion_is_restarted_soon(tmp_path: Path) -> None:
    smoothed = swung(tmp_path, 2, 2.5, 0.0, 0.0)
    assert longest_window(smoothed, STEP) == WINDOW_S
