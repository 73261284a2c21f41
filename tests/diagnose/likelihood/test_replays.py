"""Replays at coarse steps, corrected by finer ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.diagnose.hidden_forces import STEP, chain, record
from wt.diagnose.likelihood.replays import COARSE, Extrapolated, Replays, longest_step
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.scene import Scene
from wt.types import Location


def prepared(folder: Path, xml: str) -> tuple[Scene, list[Stretch]]:
    path = folder / "chain.xml"
    path.write_text(xml)
    scene = Scene(path)
    fit = smooth(scene, [Part(record(chain(2), None, 4.0, 0), 0)])
    return scene, [s for s, _ in stretches_of(fit, True)]


def test_two_step_lengths_tell_what_steps_of_no_length_say(tmp_path: Path) -> None:
    scene, stretches = prepared(tmp_path, chain(2))
    step = 4 * STEP
    exact = Replayer(scene, stretches, step / 32).run([()]).q[0]
    made = Extrapolated(scene, stretches, step)
    assert made.coarse.step == COARSE * step

    def off(q: np.ndarray) -> float:
        return float(np.sqrt(np.mean((q - exact) ** 2)))

    plain = off(made.run([()])[0])
    q, changes = made.around((), [(), ()])
    assert off(q) < 0.2 * plain
    assert off(made.run([()])[0]) == off(q)
    assert changes.shape == (2, *q.shape) and not changes.any()
    # what is left is known, and is far less than what was taken away
    left = off(exact + made.unsettled(()))
    assert 0.3 * off(q) < left < 1.5 * off(q) < 0.5 * off(q - made.correction)


def test_a_machine_too_stiff_for_coarse_steps_gets_fine_ones(tmp_path: Path) -> None:
    """An explicit integrator, and a servo that damps more than it bears at the coarse step."""
    stiff = chain(2).replace("implicitfast", "Euler")
    scene, stretches = prepared(tmp_path, stiff)
    made = Extrapolated(scene, stretches, STEP)
    assert made.coarse.step == made.slopes.step == STEP
    q = made.around((), [()])[0]
    exact = Replayer(scene, stretches, STEP / 16).run([()]).q[0]
    # nothing is extrapolated, and what that leaves is not said to be less
    assert np.std(exact - q) < 1.1 * np.std(made.unsettled(()))


def test_a_stiff_law_takes_the_short_steps_and_the_rest_long_ones(tmp_path: Path) -> None:
    scene, stretches = prepared(tmp_path, chain(2))
    at = Location("joint", "j2")
    play = Planted(effects()["joint.backlash"], at, np.array([0.02, 0.0]))
    rubs = Planted(effects()["joint.friction_viscous"], at, np.array([0.1]))
    made = Replays(scene, stretches, STEP, 4 * STEP)
    assert made.of((rubs,)).coarse.step == 4 * COARSE * STEP
    assert made.of((rubs, play)).coarse.step == COARSE * STEP
    asked = [(), (rubs,), (play,), (rubs, play)]
    exact = [Replayer(scene, stretches, STEP / 8).run([h]).q[0] for h in asked]
    for reference in ((rubs,), (rubs, play)):  # of either kind
        made.around(reference, [])
        off = np.sqrt(np.mean((made.run(asked) - exact) ** 2, axis=(1, 2)))
        assert (off[:2] < 1e-4).all()
        assert (off[2:] < 4e-3).all()  # of a motion in a play of 0.02 rad; with long steps 0.13
    assert made.run([]).shape == (0, *exact[0].shape)


def test_a_drive_that_lets_go_takes_the_short_steps(tmp_path: Path) -> None:
    """Within its dead band a servo damps nothing, but long steps are stable by its damping."""
    scene, stretches = prepared(tmp_path, chain(2))
    dead = Planted(effects()["actuator.deadband"], Location("actuator", "a2"), np.array([0.15]))
    exact = Replayer(scene, stretches, STEP / 8).run([(dead,)]).q[0]
    made, long = Replays(scene, stretches, STEP, 4 * STEP), Extrapolated(scene, stretches, 4 * STEP)
    made.around((), [])
    long.around((), [])
    off, otherwise = (np.abs(some.run([(dead,)])[0] - exact).max() for some in (made, long))
    assert off < 0.5 * otherwise


def test_steps_are_as_long_as_noise_can_tell(tmp_path: Path) -> None:
    path = tmp_path / "chain.xml"
    path.write_text(chain(2).replace(f'timestep="{STEP}"', 'timestep="0.004"'))
    fit = smooth(Scene(path), [Part(record(chain(2), None, 4.0, 0), 0)])
    stretches = [s for s, _ in stretches_of(fit, True)]
    steps = [
        longest_step(replace(fit, noise=noise * fit.noise), stretches, STEP)
        for noise in (1e-3, 1.0, 1e3)
    ]
    assert steps[0] == STEP
    assert steps[0] <= steps[1] <= steps[2]
    assert steps[2] == 0.004
