"""Laws of contacts, of payloads that move and of feet, against what they must keep."""

from __future__ import annotations

import functools
import math

import mujoco
import numpy as np
import pytest

from wt.prove.hidden import HiddenLaw, Parameters, Plant, WorldLaw
from wt.prove.laws import LAWS
from wt.prove.legged_catalog import mass
from wt.prove.legged_motions import reference
from wt.prove.legged_rigs import QUADRUPED
from wt.prove.rigs import RIGS
from wt.prove.trajectory import HiddenTrajectory

G = 9.81


def law(effect: str, place: str, **parameters: object) -> HiddenLaw:
    found: Parameters = dict(parameters)
    return LAWS[effect](place, found, np.random.default_rng(0))


class Spy(WorldLaw):
    """Notes positions of a body in another's frame, and the force of the floor."""

    def __init__(self, body: str = "", within: str = "trunk") -> None:
        super().__init__(within, {}, np.random.default_rng(0))
        self.body, self.at = body, list[np.ndarray]()
        self.force, self.slip = list[np.ndarray](), list[float]()

    def act(self, plant: Plant, t: float) -> None:
        data, total = plant.data, np.zeros(3)
        for i, contact in enumerate(data.contact):
            if plant.model.geom("floor").id in contact.geom:
                wrench = np.zeros(6)
                mujoco.mj_contactForce(plant.model, data, i, wrench)
                sign = 1.0 if contact.geom[0] == plant.model.geom("floor").id else -1.0
                total += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
        self.force.append(total)
        if self.body:
            frame = data.body(self.place)
            self.at.append(frame.xmat.reshape(3, 3).T @ (data.body(self.body).xpos - frame.xpos))


def stand(*laws: HiddenLaw, seconds: float = 2.0, kind: str = "") -> tuple[Plant, HiddenTrajectory]:
    """A quadruped that stands still, or moves; sampled at 100 Hz after a second."""
    plant = Plant(QUADRUPED, list(laws), 1.0, np.ones((2, 12)), step=0.001)
    t = np.arange(0, seconds, 0.01)
    path = np.tile(QUADRUPED.middle, (len(t), 1))
    if kind:
        path = reference(QUADRUPED, kind, t, 1.0, np.random.default_rng(3))
    return plant, plant.run(path[0], np.arange(len(t)) * 10, lambda k, q, v: path[k], 1000)


@functools.lru_cache
def plain() -> HiddenTrajectory:
    return stand()[1]


def lean(trace: HiddenTrajectory) -> np.ndarray:
    """Angle of the trunk's own vertical to the world's [rad]."""
    _, x, y, _ = trace.base_q[:, 3:].T
    return np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))


def test_the_floor_carries_the_robot() -> None:
    spy = Spy()
    stand(spy)
    # lead-in included: the last second is still
    force = np.mean(spy.force[-1000:], axis=0)
    np.testing.assert_allclose(force, [0, 0, mass(QUADRUPED) * G], atol=0.3)


def test_a_slope_leans_the_robot_and_leaves_gravity() -> None:
    spy = Spy()
    plant, trace = stand(law("contact.slope", "floor", angle=0.06, direction=0.0), spy)
    np.testing.assert_allclose(plant.model.opt.gravity, [0, 0, -G])
    # it descends towards +x, and so does the trunk's nose: rotation about +y
    w, _, y, _ = trace.base_q[-1, 3:]
    level = 2 * math.asin(plain().base_q[-1, 5])
    assert 2 * math.atan2(y, w) - level == pytest.approx(0.06, abs=0.01)
    # friction holds it: the floor's force is still the weight, straight up
    force = np.mean(spy.force[-500:], axis=0)
    np.testing.assert_allclose(force, [0, 0, mass(QUADRUPED) * G], atol=1.0)


def test_a_smooth_foot_and_a_slippery_floor() -> None:
    plant, _ = stand(law("contact.friction", "FR_foot", friction=0.2), seconds=0.1)
    found = {f.name: plant.model.geom(f.name).friction[0] for f in QUADRUPED.feet}
    assert found == {"FL_foot": 0.8, "FR_foot": 0.2, "RL_foot": 0.8, "RR_foot": 0.8}
    firm = stand(seconds=3.0, kind="trot")[1]
    slid = stand(law("contact.friction", "floor", friction=0.12), seconds=3.0, kind="trot")[1]
    assert np.abs(firm.base_q[:, :2] - slid.base_q[:, :2]).max() > 0.02


def test_soft_ground_lets_feet_sink() -> None:
    _, soft = stand(law("contact.compliance", "floor", time_constant=0.07))
    sunk = plain().base_q[-1, 2] - soft.base_q[-1, 2]
    assert 0.005 < sunk < 0.03
    _, one = stand(law("contact.compliance", "FL_foot", time_constant=0.07))
    # its corner goes down: a roll to the left, about −x
    assert 2 * one.base_q[-1, 4] < 2 * plain().base_q[-1, 4] - 0.005


BALL: Parameters = {"mass": 3.0, "travel": 0.2, "position": [0.0, 0.0, 0.13], "radius": 0.045,
                    "breadth": 0.1}  # fmt: skip


def test_a_ball_stays_in_its_box_and_weighs_what_it_weighs() -> None:
    spy = Spy("ball")
    stand(law("body.payload_moving", "trunk", **BALL), spy, seconds=3.0, kind="squat")
    at = np.array(spy.at) - np.array(BALL["position"])
    assert (np.abs(at).max(axis=0) < np.array([0.1, 0.05, 0.002]) + 0.004).all()
    assert np.ptp(at[:, 0]) > 0.05
    still = Spy()
    stand(law("body.payload_moving", "trunk", **BALL), still)
    force = np.mean(still.force[-1500:], axis=0)[2]
    assert force == pytest.approx((mass(QUADRUPED) + 3.0) * G, rel=0.01)


def test_rails_end_and_slow_down() -> None:
    spy = Spy("block")
    rails = law("payload.rails", "trunk", mass=2.0, travel=0.1, position=[0, 0, 0.1], damping=8.0)
    slope = law("contact.slope", "floor", angle=0.1, direction=0.0)
    stand(slope, rails, spy, seconds=2.0)
    x = np.array(spy.at)[:, 0]
    # downhill at g·sin(lean)·mass/damping, and stopped half the travel from the middle
    assert x.max() == pytest.approx(0.05, abs=0.003)
    assert np.diff(x).max() / 0.001 < 1.6 * G * math.sin(0.12) * 2.0 / 8.0


def test_liquid_swings_at_its_frequency() -> None:
    spy = Spy("block")
    slosh = law("payload.slosh", "trunk", mass=0.1, travel=0.4, position=[0, 0, 0.1],
                frequency=8.0, ratio=0.0)  # fmt: skip
    stand(slosh, spy, seconds=4.0)
    x = np.array(spy.at)[1500:, 0]
    x = x - x.mean()
    crossings = np.flatnonzero((x[1:] > 0) & (x[:-1] <= 0)) * 0.001
    period = np.diff(crossings).mean()
    assert 2 * math.pi / period == pytest.approx(8.0, rel=0.05)


def test_glue_holds_a_foot_and_costs_nothing_at_rest() -> None:
    spy = Spy()
    stand(law("outsider.sticky_foot", "FL_foot", pull=30.0, reach=0.004), spy)
    force = np.mean(spy.force[-1000:], axis=0)[2]
    assert force == pytest.approx(mass(QUADRUPED) * G + 30.0, rel=0.01)


def test_a_loose_pad_gives_by_its_gap() -> None:
    plant, trace = stand(law("outsider.loose_pad", "RR_foot", gap=0.01))
    assert plant.data.joint("pad").qpos[0] == pytest.approx(0.01, abs=0.002)
    assert lean(trace)[-1] > lean(plain())[-1]


def test_a_cable_pulls_against_the_way() -> None:
    cable = law("outsider.trailing_cable", "trunk", level=5.0, more=10.0)
    plant = Plant(QUADRUPED, [cable], 1.0, np.ones((2, 12)))
    plant.data.qvel[0] = 0.4
    for moved, force in ((0.0, 5.0), (0.3, 8.0)):
        plant.data.qpos[0] = moved
        mujoco.mj_forward(plant.model, plant.data)
        plant.data.xfrc_applied[:] = 0.0
        cable.act(plant, 0.0)  # type: ignore[attr-defined]
        found = plant.data.xfrc_applied[plant.body("trunk"), :3]
        np.testing.assert_allclose(found, [-force * 0.4 / math.hypot(0.4, 0.02), 0, 0], atol=1e-6)


def test_an_arm_does_not_go_through_a_wall() -> None:
    rig = RIGS["arm3"]
    wall = law("contact.obstacle", "world", position=[0.0, 0.3, 0.4], normal=[0.0, -1.0, 0.0])
    path = np.zeros((200, 3)) + np.array([0.0, -0.5, 0.7])
    path[:, 0] = np.linspace(0.0, 1.2, 200)
    ends = []
    for laws in ([], [wall]):
        plant = Plant(rig, laws, 1.0, np.ones((2, 3)))
        plant.run(path[0], np.arange(200) * 20, lambda k, q, v: path[k], 500)
        mujoco.mj_kinematics(plant.model, plant.data)
        ends.append(float(plant.data.site("tip").xpos[1]))
    assert ends[0] > 0.35
    # the capsule's surface is at the face, give or take what a stiff contact gives
    assert ends[1] == pytest.approx(0.3 - rig.links[-1].radius, abs=0.01)
