"""Replays at coarse steps, corrected by finer ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.diagnose.hidden_forces import STEP, chain, record
from wt.diagnose.likelihood.replays import Extrapolated, Replays, like
from wt.diagnose.likelihood.steps import COARSE, Accuracy, Steps, longest_steps
from wt.diagnose.recordings.samples import Part
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import stretches_of
from wt.physics import workers
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.replay import Stretch
from wt.physics.rollout import Replayer
from wt.physics.runner import chosen
from wt.physics.scene import Scene
from wt.physics.spread import over
from wt.types import Location, Recording


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
    made = Extrapolated(scene, stretches, Steps.usual(step))
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
    made = Extrapolated(scene, stretches, Steps.usual(STEP))
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
    made = Replays(scene, stretches, STEP, Steps.usual(4 * STEP))
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
    made, long = (
        Replays(scene, stretches, STEP, Steps.usual(4 * STEP)),
        Extrapolated(scene, stretches, Steps.usual(4 * STEP)),
    )
    made.around((), [])
    long.around((), [])
    off, otherwise = (np.abs(some.run([(dead,)])[0] - exact).max() for some in (made, long))
    assert off < 0.5 * otherwise


def test_processes_say_the_same_of_what_was_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is replayed refers to the recordings, and these to the machine."""
    scene, stretches = prepared(tmp_path, chain(2))
    law = Planted(
        effects()["joint.friction_stribeck"], Location("joint", "j2"), np.array([0.1, 0.2, 0.1])
    )
    here = Replayer(scene, stretches, 4 * STEP).run([(law,)])
    monkeypatch.setattr(workers, "_WORTH_S", 0.0)
    monkeypatch.setattr(workers, "_WORTH_STEPS", 1)
    with over(2):
        there, runner = Replayer(scene, stretches, 4 * STEP).run([(law,)]), chosen()
        assert isinstance(runner, workers.Workers) and runner._processes
    assert there.q.tobytes() == here.q.tobytes()


def test_a_stiff_law_gets_steps_as_long_as_noise_can_tell(tmp_path: Path) -> None:
    path = tmp_path / "chain.xml"
    path.write_text(chain(2).replace(f'timestep="{STEP}"', 'timestep="0.004"'))
    fit = smooth(Scene(path), [Part(record(chain(2), None, 4.0, 0), 0)])
    stretches = [s for s, _ in stretches_of(fit, True)]
    drive = Location("actuator", "a2")
    little, much = (
        (Planted(effects()["actuator.deadband"], drive, np.array([w])),) for w in (0.02, 0.3)
    )
    given = np.full(2, 1e-3)
    for noise, longest in ((1e-7, COARSE * STEP), (1.0, 0.008)):
        steps = Steps(0.004, 0.008, Accuracy(np.full(2, noise), given))
        made = Replays(fit.motion.scene, stretches, STEP, steps)
        usual = made.of(little)  # nothing is known of it yet
        assert usual.coarse.step == COARSE * STEP
        q = made.around(little, [])[0]
        assert made.of(little).coarse.step == longest
        np.testing.assert_array_equal(made.run([little])[0], q)
        # one that is unlike it is looked at anew, another law not before it is a reference
        stop = Planted(effects()["joint.stop"], Location("joint", "j2"), np.array([2.0, 1.0]))
        assert made.of((*little, stop)) is usual
        before = made.of(much)
        made.around(much, [])
        assert made.of(much) is not before


def test_steps_are_as_long_as_noise_can_tell(tmp_path: Path) -> None:
    path = tmp_path / "chain.xml"
    path.write_text(chain(2).replace(f'timestep="{STEP}"', 'timestep="0.004"'))
    fit = smooth(Scene(path), [Part(record(chain(2), None, 4.0, 0), 0)])
    steps = [
        longest_steps(replace(fit, noise=noise * fit.noise), stretches_of(fit, True), STEP)
        for noise in (1e-3, 1.0, 1e3)
    ]
    fine, coarse = [s.fine for s in steps], [s.coarse for s in steps]
    assert fine[0] == STEP and fine[0] <= fine[1] <= fine[2] == 0.004
    assert coarse[0] == COARSE * STEP and coarse[0] <= coarse[1] <= coarse[2] == 0.008


def test_few_probes_are_replayed_at_steps_finer_than_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pendulum.xml"
    path.write_text(pendulum(0.002))
    fit = smooth(Scene(path), [Part(swings(path), 0)])
    replayed: Counter[float] = Counter()
    part = Replayer.part

    def counted(self: Replayer, hypotheses: Sequence[object], *more: object) -> np.ndarray:
        replayed[self.step] += len(hypotheses)
        return part(self, hypotheses, *more)  # type: ignore[arg-type]

    monkeypatch.setattr(Replayer, "part", counted)
    assert longest_steps(fit, stretches_of(fit, False), STEP).fine == 4 * STEP
    assert replayed[STEP] == replayed[2 * STEP] == 2
    assert replayed[4 * STEP] == 5


def test_coarse_steps_are_as_long_as_they_tell_hypotheses_apart(tmp_path: Path) -> None:
    """Longer than those that say exactly where a machine goes."""
    path = tmp_path / "pendulum.xml"
    path.write_text(pendulum(0.002))
    fit = smooth(Scene(path), [Part(swings(path), 0)])
    pairs = stretches_of(fit, False)
    steps = longest_steps(fit, pairs, STEP)
    assert (steps.fine, steps.coarse) == (0.002, 0.008)
    stretches = [s for s, _ in pairs]
    made = Extrapolated(fit.motion.scene, stretches, steps)
    usual = Extrapolated(fit.motion.scene, stretches, Steps.usual(steps.fine))
    assert made.coarse.step == steps.coarse
    rubs = Planted(effects()["joint.friction_viscous"], Location("joint", "j"), np.array([2e-3]))
    here, there = (
        Replayer(fit.motion.scene, stretches, STEP / 8).run([h]).q[0] for h in ((), (rubs,))
    )
    for some in (made, usual):
        q = some.around((), [])[0]
        off, apart = q - here, some.run([(rubs,)])[0] - q - (there - here)
        assert np.sqrt(np.mean(off**2)) < fit.noise.max()
        assert np.sqrt(np.mean(apart**2)) < 0.7 * fit.noise.max()


def pendulum(timestep: float) -> str:
    return f"""
<mujoco><option timestep="{timestep}" integrator="implicitfast"/><worldbody><body>
  <joint name="j" axis="0 1 0"/><inertial pos="0 0 -.3" mass="1" diaginertia=".01 .01 .01"/>
</body></worldbody></mujoco>"""


def swings(path: Path) -> Recording:
    """A pendulum let go, seen by an encoder at 200 Hz."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep, model.dof_damping[0] = 1e-4, 0.02
    data, q = mujoco.MjData(model), []
    data.qpos[0] = 1.5
    for _ in range(800):
        q.append(data.qpos[0])
        mujoco.mj_step(model, data, 50)
    noisy = np.array(q) + np.random.default_rng(0).normal(0.0, 2e-4, len(q))
    return Recording(np.arange(800) * 0.005, {"qpos/j": noisy}, {})


def test_laws_of_one_place_with_more_terms_are_not_alike() -> None:
    """What was learned twice, with other terms, ended a diagnosis by an error of shapes."""
    viscous, at = effects()["joint.friction_viscous"], Location("joint", "j1")
    two, four = ((Planted(viscous, at, np.ones(n)),) for n in (2, 4))
    assert like(two, two) and not like(two, four)
