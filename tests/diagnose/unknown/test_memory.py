from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.diagnose.hidden_forces import World, world
from tests.physics.machine_code import called
from wt.diagnose.unknown.law import Atom, Law
from wt.diagnose.unknown.live import live
from wt.diagnose.unknown.memory import Memory, along, memory_of, recorded
from wt.types import Location

CREEP = Memory("creep", "j1", 0.35)
SWING, RATE = (Memory(kind, "j1", 9.0, 0.1) for kind in ("swing", "swing_rate"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A chain of one joint, nothing hidden."""
    return world(tmp_path_factory.mktemp("plain"), 1, None, seconds=6.0)


def integrated(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Creep, swing and its rate by an integrator of scipy's, (T, 3)."""

    def slope(now: float, x: np.ndarray) -> list[float]:
        at, speed = float(np.interp(now, t, q)), float(np.interp(now, t, v))
        pull = 81.0 * (at - x[1]) + 1.8 * (speed - x[2])
        return [speed - x[0] / 0.35, x[2], pull]

    found = solve_ivp(slope, (t[0], t[-1]), [0.0, q[0], v[0]], t_eval=t, rtol=1e-8, max_step=0.005)
    return np.stack([found.y[0], found.y[1] - q, found.y[2] - v], axis=1)


def test_memories_follow_their_equations(plain: World) -> None:
    m = plain.screen.motion
    names = [CREEP.name, SWING.name, RATE.name]
    got = along(m, names)
    rows = m.segments[0].rows
    want = integrated(m.t[rows], m.q[rows, 0], m.v[rows, 0])
    size = np.sqrt((want**2).mean(axis=0))
    assert (np.sqrt(((got[rows] - want) ** 2).mean(axis=0)) < 0.01 * size).all()


def test_replays_remember_as_recordings_do(plain: World) -> None:
    m = plain.screen.motion
    rows = m.segments[0].rows
    t, q, v = m.t[rows], m.q[rows], m.v[rows]
    names = ("qvel/j1", CREEP.name, SWING.name, RATE.name)
    want = along(m, names)[rows]
    h, steps = 5e-4, 4000
    times = t[0] + h * np.arange(steps)
    fine_q, fine_v = (np.interp(times, t, x[:, 0]) for x in (q, v))
    for i, name in enumerate(names):
        column = want[:, i]
        # alone, and where it is trusted
        alone = Law((name,), np.array([-1e9]), np.array([1e9]), ((Atom(0, "linear"),),), np.ones(1))
        acting = live(alone, m.scene, [Location("joint", "j1")], np.ones((1, 1)), h)
        got = [
            called(acting, fine_q[k : k + 1], fine_v[k : k + 1], np.zeros(1), times[k], h)
            for k in range(steps)
        ]
        np.testing.assert_allclose(
            got, np.interp(times, t, column), atol=0.02 * np.abs(column).max(), err_msg=name
        )


@pytest.mark.parametrize("memory", [CREEP, SWING, RATE])
def test_a_name_says_all_of_it(memory: Memory) -> None:
    assert memory_of(memory.name) == memory
    assert set(recorded([memory.name, "qvel/j1"])) <= {"qpos/j1", "qvel/j1"}


@pytest.mark.parametrize("name", ["qpos/j1", "t", "ctrl/a1", "force/a1"])
def test_what_is_recorded_is_no_memory(name: str) -> None:
    assert memory_of(name) is None
    assert recorded([name]) == (name,)
