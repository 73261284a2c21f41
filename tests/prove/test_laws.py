"""Laws of the hidden world against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from wt.prove.hidden import CommandLaw, HiddenLaw, HiddenTrajectory, Parameters, Plant
from wt.prove.rigs import RIGS
from wt.prove.world import LAWS

G, MASS, LENGTH = 9.81, 1.2, 0.4  # of the pendulum: a uniform capsule of 0.4 m and radius 0.03
MGL = MASS * G * LENGTH / 2
SERVO, MOTOR = RIGS["pendulum"], RIGS["pendulum_motor"]
FREE = np.array([[1.0], [0.0]])  # masses exact, no damping
KP = SERVO.links[0].kp


def law(effect: str, parameters: Parameters, place: str = "hinge") -> HiddenLaw:
    return LAWS[effect](place, parameters, np.random.default_rng(0))


def pendulum(*laws: HiddenLaw, motor: bool = False, off: np.ndarray = FREE) -> Plant:
    return Plant(MOTOR if motor else SERVO, list(laws), 1.0, off)


def run(
    plant: Plant, u: float | Callable[[float], float], seconds: float, q0: float
) -> HiddenTrajectory:
    """Sampled at 1 kHz from a still start at q0."""
    steps = np.arange(int(seconds * 1000)) * round(0.001 / plant.h)
    command = u if callable(u) else lambda t: u
    start = np.array([q0])
    return plant.run(start, steps, lambda k, q, v: np.array([float(command(k * 1e-3))]), 0)


def rest(*laws: HiddenLaw, u: float) -> float:
    """Where the servo settles."""
    return float(run(pendulum(*laws), u, 1.5, u).fine_q[-1, 0])


def peaks(q: np.ndarray) -> np.ndarray:
    inner = (q[1:-1] - q[:-2]) * (q[2:] - q[1:-1]) < 0
    return q[1:-1][inner]


def test_coulomb_takes_its_torque_times_the_way_from_a_free_pendulum() -> None:
    trace = run(pendulum(law("joint.friction_coulomb", {"coulomb": 0.05}), motor=True), 0, 3, 0.9)
    q = peaks(trace.fine_q[:, 0])[:5]
    # between still points mgl·Δ(cos q) = F·|Δq|
    lost = MGL * (np.cos(q[1:]) - np.cos(q[:-1]))
    np.testing.assert_allclose(lost / np.abs(np.diff(q)), 0.05, rtol=0.02)


def test_nothing_hidden_keeps_the_energy() -> None:
    trace = run(pendulum(motor=True), 0.0, 6.0, 0.9)
    np.testing.assert_allclose(np.abs(peaks(trace.fine_q[:, 0])), 0.9, atol=2e-5)


def test_viscous_decay_of_small_swings() -> None:
    trace = run(
        pendulum(law("joint.friction_viscous", {"coefficient": 0.04}), motor=True), 0, 4, 0.02
    )
    inertia = pendulum().inertia(0)
    q = np.abs(peaks(trace.fine_q[:, 0]))
    # per half cycle exp(−c·π/(2·I·ω))
    omega = math.sqrt(MGL / inertia - (0.04 / (2 * inertia)) ** 2)
    expected = math.exp(-0.04 * math.pi / (2 * inertia * omega))
    np.testing.assert_allclose(q[1:6] / q[:5], expected, rtol=2e-3)


def test_a_servo_that_feeds_back_less_velocity_swings_as_one_with_less_friction() -> None:
    """Of no velocity at all: what is left is the joint's own friction."""
    kv = SERVO.links[0].kv
    damped = law("actuator.damping", {"factor": 0.25}, "hinge_drive")
    rubbing = law("joint.friction_viscous", {"coefficient": -0.75 * kv})
    one, other = (run(pendulum(x), 0.3, 0.5, 0.0).fine_q for x in (damped, rubbing))
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert one.max() > run(pendulum(), 0.3, 0.5, 0.0).fine_q.max() + 0.01


def test_feedforward_of_all_its_damping_lets_a_servo_follow_without_lag() -> None:
    """A light load at a constant speed: the servo's own damping takes speed · kv."""
    kv, speed = SERVO.links[0].kv, 0.5
    ramp = lambda t: speed * math.floor(t * 100.0 + 1e-6) / 100.0  # noqa: E731 – held for 10 ms
    ahead = law("actuator.feedforward", {"coefficient": kv}, "hinge_drive")
    lags = [speed * 1.0 - run(pendulum(*laws), ramp, 1.001, 0.0).fine_q[-1, 0]
            for laws in ((), (ahead,))]  # fmt: skip
    assert lags[0] - lags[1] == pytest.approx(kv * speed / (KP + MGL * math.cos(0.5)), rel=0.03)


def test_feedforward_ends_with_the_motion() -> None:
    ahead = law("actuator.feedforward", {"coefficient": 5.0}, "hinge_drive")
    moved = run(pendulum(ahead), lambda t: 0.3 * (t >= 0.2), 1.5, 0.0).fine_q[-1, 0]
    assert moved == pytest.approx(rest(u=0.3), abs=1e-5)


def test_integral_action_holds_a_weight_without_an_error_in_the_end() -> None:
    held = law("actuator.integral", {"ki": 4.0 * KP}, "hinge_drive")
    assert rest(u=0.3) < 0.28
    assert run(pendulum(held), 0.3, 4.0, 0.3).fine_q[-1, 0] == pytest.approx(0.3, abs=1e-4)


def test_integral_action_takes_over_with_its_time_constant() -> None:
    """Near a rest without gravity's slope the error falls by exp(−ki/kp · t)."""
    held = law("actuator.integral", {"ki": 0.5 * KP}, "hinge_drive")
    plant = pendulum(held)
    error = 1.2 - run(plant, 1.2, 4.0, 1.2).fine_q[:: round(1.0 / plant.h), 0]
    slope = KP + MGL * math.cos(1.2)
    np.testing.assert_allclose(error[2] / error[1], math.exp(-0.5 * KP / slope), rtol=0.02)


def test_a_goal_of_limited_speed_takes_as_long_as_the_way_is() -> None:
    slow = law("actuator.slew_rate", {"speed": 0.5}, "hinge_drive")
    h = pendulum(slow).h
    goals = np.array([_sent(slow, 0.3 if k else 0.0) for k in range(1000)])
    np.testing.assert_allclose(goals[1:200], 0.5 * h * (np.arange(1, 200) - 0.5), atol=1e-12)
    assert _sent(slow, 0.3) <= 0.3


def test_a_profile_is_a_trapezoid_of_velocity() -> None:
    """From rest to rest over a way l: l/speed + speed/acceleration."""
    planned = law("actuator.profile", {"speed": 0.8, "acceleration": 4.0}, "hinge_drive")
    h = pendulum(planned).h
    goals = np.array([_sent(planned, 0.5 if k else 0.0) for k in range(round(1.5 / h))])
    there = float(np.flatnonzero(goals < 0.5 - 1e-6)[-1]) * h
    assert there == pytest.approx(0.5 / 0.8 + 0.8 / 4.0, abs=4.0 * h)
    assert goals.max() < 0.5 + 1e-5
    rates = np.diff(goals) / h
    assert rates.max() == pytest.approx(0.8, rel=1e-6)
    assert np.abs(np.diff(rates))[1:-1].max() < 1.6 * 4.0 * h


def _sent(hidden: HiddenLaw, u: float) -> float:
    """What a law makes of a command."""
    assert isinstance(hidden, CommandLaw)
    return hidden.command(u)


def test_armature_slows_small_swings() -> None:
    added = 0.05
    trace = run(pendulum(law("joint.armature", {"inertia": added}), motor=True), 0.0, 4.0, 0.02)
    q = trace.fine_q[:, 0]
    falling = np.flatnonzero((q[:-1] > 0) & (q[1:] <= 0))
    period = np.diff(falling).mean() * trace.h
    expected = 2 * math.pi * math.sqrt((pendulum().inertia(0) + added) / MGL)
    assert period == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("effect", "parameters", "place", "balance"),
    [
        # kp·(u − q)·factor + extra = gravity, as (factor, added torque, mgl)
        ("actuator.gain", {"factor": 0.6}, "hinge_drive", lambda q: (0.6, 0.0, MGL)),
        ("actuator.bias", {"torque": 0.7}, "hinge_drive", lambda q: (1.0, 0.7, MGL)),
        ("actuator.ripple", {"amplitude": 0.4, "cycles": 6.0, "phase": 0.3}, "hinge_drive",
         lambda q: (1.0, 0.4 * math.sin(6 * q + 0.3), MGL)),
        ("joint.stiffness", {"stiffness": 3.0, "reference": 0.2}, "hinge",
         lambda q: (1.0, -3.0 * (q - 0.2), MGL)),
        ("body.mass", {"factor": 1.5}, "rod", lambda q: (1.0, 0.0, 1.5 * MGL)),
        ("body.com", {"shift": [0.0, 0.0, -0.05]}, "rod",
         lambda q: (1.0, 0.0, MGL + MASS * G * 0.05)),
        ("body.payload_fixed", {"mass": 0.5, "position": [0.0, 0.0, -0.35]}, "rod",
         lambda q: (1.0, 0.0, MGL + 0.5 * G * 0.35)),
        ("body.force", {"force": [4.0, 0.0, 0.0]}, "rod",
         lambda q: (1.0, -4.0 * 0.2 * math.cos(q), MGL)),
        ("outsider.detent", {"torque": 0.5, "angle": 0.8, "width": 0.2}, "hinge",
         lambda q: (1.0, -0.5 * (q - 0.8) / 0.2 * math.exp(0.5 - 0.5 * ((q - 0.8) / 0.2) ** 2),
                    MGL)),
    ],
)  # fmt: skip
def test_balance_at_rest(
    effect: str,
    parameters: Parameters,
    place: str,
    balance: Callable[[float], tuple[float, float, float]],
) -> None:
    q = rest(law(effect, parameters, place), u=0.9)
    factor, added, mgl = balance(q)
    assert factor * KP * (0.9 - q) + added == pytest.approx(mgl * math.sin(q), abs=2e-4)
    assert abs(q - rest(u=0.9)) > 0.003


def test_deadband_and_saturation_at_rest() -> None:
    width = 0.5
    q = rest(law("actuator.deadband", {"width": width}, "hinge_drive"), u=0.9)
    assert KP * (0.9 - q) - width == pytest.approx(MGL * math.sin(q), abs=2e-3)
    # held at most at the angle whose gravity equals the limit
    limit, damped = (
        law("actuator.saturation", {"torque": 1.2}, "hinge_drive"),
        np.array([[1.0], [10.0]]),
    )
    q = run(pendulum(limit, off=damped), 1.0, 2.5, 0.5).fine_q[-1, 0]
    assert MGL * math.sin(q) == pytest.approx(1.2, rel=0.01)


def test_gravity_leans_where_it_is_told_to() -> None:
    tilt = law("world.gravity", {"angle": 0.2, "direction": 0.0}, "world")
    damped = np.array([[1.0], [8.0]])
    q = run(pendulum(tilt, motor=True, off=damped), 0.0, 4.0, 0.0).fine_q[-1, 0]
    # towards +x, and a positive turn about y takes the hanging rod to −x
    assert q == pytest.approx(-0.2, abs=1e-4)


def test_backlash_twist_at_rest_is_half_the_gap() -> None:
    for u in (0.8, -0.8):
        q = rest(law("joint.backlash", {"gap": 0.03}), u=u)
        motor = u - MGL * math.sin(q) / KP
        assert motor - q == pytest.approx(math.copysign(0.015, u), rel=0.01)


def test_elastic_twist_at_rest_is_torque_over_stiffness() -> None:
    q = rest(law("joint.elasticity", {"stiffness": 80.0, "damping": 0.1}), u=0.8)
    torque = MGL * math.sin(q)
    assert (0.8 - torque / KP) - q == pytest.approx(torque / 80.0, rel=1e-3)


def test_delay_shifts_the_answer_by_its_parameter() -> None:
    plain = run(pendulum(), lambda t: 0.5 * (t > 0.5), 1.2, 0.0).fine_q[:, 0]
    late = run(
        pendulum(law("actuator.delay", {"delay": 0.0137}, "hinge_drive")),
        lambda t: 0.5 * (t > 0.5), 1.2, 0.0,
    ).fine_q[:, 0]  # fmt: skip
    t = np.arange(len(plain)) * pendulum().h
    np.testing.assert_allclose(late[2000:], np.interp(t - 0.0137, t, plain)[2000:], atol=2e-5)


def test_lag_is_first_order() -> None:
    plant = pendulum()
    lag = law("actuator.lag", {"time_constant": 0.03}, "hinge_drive")
    lag.bind(plant)
    lag.command(0.0)  # type: ignore[attr-defined]
    out = [lag.command(1.0) for _ in range(400)]  # type: ignore[attr-defined]
    t = (np.arange(400) + 0.5) * plant.h
    np.testing.assert_allclose(out, 1 - np.exp(-t / 0.03), atol=1e-9)


def test_speed_limit_is_the_speed_of_a_free_motor() -> None:
    plant = pendulum(
        law("actuator.speed_limit", {"stall": 1.0, "speed": 4.0}, "hinge_drive"), motor=True
    )
    plant.model.opt.gravity[:] = 0
    plant.model.jnt_limited[:] = 0
    trace = run(plant, 5.0, 3.0, 0.0)
    v = trace.fine_v[:, 0]
    # I·v̇ = stall·(1 − v/speed)
    t = np.arange(len(v)) * plant.h
    expected = 4.0 * (1 - np.exp(-t / (plant.inertia(0) * 4.0)))
    np.testing.assert_allclose(v, expected, atol=0.13)  # the knee: 2 % of stall, times ln 2 …
    assert v[-1] == pytest.approx(4.0, rel=0.01)


def test_fade_at_rated_torque() -> None:
    plant = pendulum()
    fade = law("actuator.fade", {"loss": 0.3, "time_constant": 2.0, "rated": 5.0}, "hinge_drive")
    fade.bind(plant)
    fade.start()
    out = [fade.torque(-5.0, 0.0, 0.0) for _ in range(round(3.0 / plant.h))]  # type: ignore[attr-defined]
    assert out[-1] == pytest.approx(-5.0 * (1 - 0.3 * (1 - math.exp(-1.5))), rel=1e-3)


def test_drag_sets_the_terminal_speed() -> None:
    plant = pendulum(law("body.drag", {"coefficient": 30.0}, "rod"), motor=True)
    plant.model.opt.gravity[:] = 0
    plant.model.jnt_limited[:] = 0
    v = run(plant, 1.5, 1.5, 0.0).fine_v[-1, 0]
    # τ = c·(v·r)²·r at r = 0.2 m
    assert v == pytest.approx(math.sqrt(1.5 / (30.0 * 0.2**3)), rel=1e-3)


def test_stop_holds() -> None:
    q = run(pendulum(law("joint.stop", {"position": 0.5, "side": 1.0})), 0.9, 1.0, 0.0).fine_q
    assert 0.5 < q[-1, 0] < 0.501
    q = run(pendulum(law("joint.stop", {"position": -0.5, "side": -1.0})), -0.9, 1.0, 0.0).fine_q
    assert -0.501 < q[-1, 0] < -0.5


def sliding(
    effect: str, parameters: Parameters, v: float, q: float = 0.0, drive: float = 0.0
) -> float:
    """Torque of a friction law in steady sliding."""
    friction, plant = law(effect, parameters), pendulum()
    friction.bind(plant)
    return [friction.joint(q, v, drive) for _ in range(8000)][-1]  # type: ignore[attr-defined]


@pytest.mark.parametrize("v", [0.02, -0.07, 0.8])
def test_steady_friction(v: float) -> None:
    sign = math.copysign(1.0, v)
    assert sliding("joint.friction_coulomb", {"coulomb": 0.3}, v) == pytest.approx(-0.3 * sign)
    parameters: Parameters = {"coulomb": 0.3, "static": 0.5, "velocity": 0.06}
    expected = 0.3 + 0.2 * math.exp(-((v / 0.06) ** 2))
    assert sliding("joint.friction_stribeck", parameters, v) == pytest.approx(-sign * expected)
    load: Parameters = {"coulomb": 0.2, "fraction": 0.15}
    got = sliding("joint.friction_load", load, v, drive=-4.0)
    assert got == pytest.approx(-sign * (0.2 + 0.15 * 4.0))
    gear: Parameters = {"drive": 0.1, "back": 0.4, "coulomb": 0.2, "viscous": 0.5}
    for drive in (-4.0, 4.0):
        share = 0.1 if drive * v > 0.0 else 0.4
        got = sliding("joint.gear_loss", gear, v, drive=drive)
        assert got == pytest.approx(-sign * (0.2 + 0.5 * abs(v) + share * 4.0))
    ways: Parameters = {
        "coulomb_forward": 0.2,
        "coulomb_backward": 0.4,
        "viscous_forward": 1.5,
        "viscous_backward": 0.5,
    }
    got = sliding("joint.friction_directional", ways, v)
    assert got == pytest.approx(-0.2 - 1.5 * v if v > 0.0 else 0.4 - 0.5 * v)
    got = sliding("joint.friction_quadratic", {"coefficient": 0.7}, v)
    assert got == pytest.approx(-0.7 * v * abs(v))
    spot: Parameters = {"coulomb": 0.4, "angle": 0.5, "width": 0.1}
    assert sliding("outsider.tight_spot", spot, v, q=0.5) == pytest.approx(-0.4 * sign, rel=2e-3)
    assert abs(sliding("outsider.tight_spot", spot, v, q=1.2)) < 1e-3
    brake: Parameters = {"coefficient": 0.5, "angle": 0.5, "width": 0.4}
    assert sliding("outsider.eddy_brake", brake, v, q=0.5) == pytest.approx(-0.5 * v, rel=0.01)
    assert abs(sliding("outsider.eddy_brake", brake, v, q=1.2)) < 1e-5


def test_hysteresis_is_a_spring_that_flows() -> None:
    plastic, plant = law("joint.hysteresis", {"stiffness": 8.0, "yield": 0.5}), pendulum()
    plastic.bind(plant)
    way = np.concatenate([np.full(8000, 0.2), np.full(40, -0.2)])  # 0.4 rad on, 2 mrad back
    torque = np.array([plastic.joint(0.0, v, 0.0) for v in way])  # type: ignore[attr-defined]
    assert torque[7999] == pytest.approx(-0.5, rel=1e-3)
    assert torque[400] == pytest.approx(-8.0 * 0.02, rel=0.02)
    assert torque[-1] - torque[7999] == pytest.approx(8.0 * 0.002, rel=1e-3)


def test_push_acts_in_its_windows_only() -> None:
    push = law(
        "body.force_intermittent", {"force": [0.0, 0.0, 3.0], "windows": [[0.5, 0.8]]}, "rod"
    )
    plant = pendulum(push)
    plant.data.xfrc_applied[:] = 0
    body = plant.body("rod")
    for t, expected in ((0.49, 0.0), (0.6, 3.0), (0.81, 0.0)):
        plant.data.xfrc_applied[:] = 0
        push.act(plant, t)  # type: ignore[attr-defined]
        assert plant.data.xfrc_applied[body, 2] == expected


def generalized(plant: Plant, q: np.ndarray, v: np.ndarray, hidden: HiddenLaw) -> np.ndarray:
    """Joint torques of what a law applies."""
    plant.data.qpos[:], plant.data.qvel[:] = q, v
    mujoco.mj_step1(plant.model, plant.data)
    plant.data.xfrc_applied[:] = 0
    plant.total[:] = 0
    hidden.act(plant, 0.0)  # type: ignore[attr-defined]
    out = plant.total.copy()
    for body in range(1, plant.model.nbody):
        jacp, jacr = np.zeros((3, plant.model.nv)), np.zeros((3, plant.model.nv))
        mujoco.mj_jacBodyCom(plant.model, plant.data, jacp, jacr, body)
        wrench = plant.data.xfrc_applied[body]
        out += jacp.T @ wrench[:3] + jacr.T @ wrench[3:]
    return out


def test_belt_is_the_slope_of_its_energy() -> None:
    belt = law("pair.spring", {"stiffness": 5.0, "ratio": -0.7, "reference": 0.2}, "shoulder+elbow")
    plant = Plant(RIGS["arm3"], [belt], 1.0, np.ones((2, 3)))
    force = generalized(plant, np.array([0.4, -0.5, 0.9]), np.zeros(3), belt)
    stretch = -0.5 - 0.7 * 0.9 - 0.2
    assert force == pytest.approx([0.0, -5.0 * stretch, 0.7 * 5.0 * stretch])


def test_crosstalk_turns_the_next_joint_by_a_share_of_the_drive() -> None:
    leak = law("pair.crosstalk", {"fraction": 0.3}, "shoulder+elbow")
    plant = Plant(RIGS["arm3"], [leak], 1.0, np.ones((2, 3)))
    plant.transmitted[:] = 5.0, -2.0, 1.0
    force = generalized(plant, np.zeros(3), np.zeros(3), leak)
    assert force == pytest.approx([0.0, 0.0, -0.6])


def test_counterweight_holds_its_share_of_the_weight() -> None:
    carried = law("world.gravity_compensation", {"share": 0.6}, "all")
    plant, q = Plant(RIGS["arm3"], [carried], 1.0, np.ones((2, 3))), np.array([0.4, -0.5, 0.9])
    force = generalized(plant, q, np.zeros(3), carried)
    assert force == pytest.approx(0.6 * plant.gravity_torques(q[None])[0], abs=1e-9)


def test_nudges_give_each_recording_its_own_impulses() -> None:
    nudges = law("joint.force_intermittent", {"torque": 0.8, "count": 3})
    plant, t = pendulum(nudges), np.arange(0.0, 14.0, 1e-3)

    def course() -> np.ndarray:
        nudges.start()
        torque = []
        for now in t:
            plant.total[:] = 0.0
            nudges.act(plant, now)  # type: ignore[attr-defined]
            torque.append(plant.total[0])
        return np.array(torque)

    one, other = course(), course()
    for torque in (one, other):
        assert 0.5 < np.abs(torque).max() < 1.1
        assert (np.abs(torque) > 0.01).mean() < 0.2
    assert np.argmax(np.abs(one)) != np.argmax(np.abs(other))


def test_tether_is_the_slope_of_its_energy() -> None:
    anchor = np.array([0.3, -0.2, 0.6])
    tether = law("body.tether", {"stiffness": 40.0, "anchor": list(anchor)}, "fore")
    plant = Plant(RIGS["arm3"], [tether], 1.0, np.ones((2, 3)))
    q = np.array([0.4, -0.5, 0.9])

    def energy(at: np.ndarray) -> float:
        plant.data.qpos[:] = at
        mujoco.mj_kinematics(plant.model, plant.data)
        return 20.0 * float(((plant.data.xpos[plant.body("fore")] - anchor) ** 2).sum())

    eye = 1e-6 * np.eye(3)
    slope = np.array([(energy(q + e) - energy(q - e)) / 2e-6 for e in eye])
    got = generalized(plant, q, np.zeros(3), tether)
    np.testing.assert_allclose(got, -slope, atol=1e-6)
    assert np.abs(got[:2]).min() > 0.1


def test_flywheel_turns_no_energy_and_couples_crossed_axes() -> None:
    # spinning about the forearm's x: turning the waist (z) pushes the elbow (y)
    wheel = law("outsider.flywheel", {"momentum": 2.0, "axis": [1.0, 0.0, 0.0]}, "fore")
    plant = Plant(RIGS["arm3"], [wheel], 1.0, np.ones((2, 3)))
    v = np.array([1.0, 0.0, 0.0])
    got = generalized(plant, np.zeros(3), v, wheel)
    # −ω × L = −(z × 2x) = −2y
    np.testing.assert_allclose(got, [0.0, -2.0, -2.0], atol=1e-9)
    v = np.array([0.3, -0.8, 1.1])
    assert generalized(plant, np.array([0.2, 0.4, 0.5]), v, wheel) @ v == pytest.approx(0, abs=1e-9)


def test_cable_pulls_when_stretched() -> None:
    parameters: Parameters = {"ratio": -0.5, "slack": 0.2, "stiffness": 10.0}
    cable = law("outsider.cable", parameters, "shoulder+elbow")
    plant = Plant(RIGS["arm3"], [cable], 1.0, np.ones((2, 3)))
    pull = 10.0 * (-0.5 * -1.0 + 1.0 - 0.2)
    got = generalized(plant, np.array([0.0, -1.0, 1.0]), np.zeros(3), cable)
    np.testing.assert_allclose(got, [0.0, 0.5 * pull, -pull], atol=1e-4)
    slack = generalized(plant, np.array([0.0, 0.5, -0.5]), np.zeros(3), cable)
    np.testing.assert_allclose(slack, 0.0, atol=1e-6)


def test_inertia_factor_leaves_the_mass() -> None:
    plain = pendulum()
    heavy = pendulum(law("body.inertia", {"factor": 5.0}, "rod"))
    own = plain.inertia(0) - 0.01 - MASS * 0.2**2  # less armature and the parallel axis
    assert heavy.inertia(0) - plain.inertia(0) == pytest.approx(4.0 * own, rel=1e-6)
    q = np.array([[0.5]])
    assert heavy.gravity_torques(q) == pytest.approx(plain.gravity_torques(q))
    assert plain.gravity_torques(q)[0, 0] == pytest.approx(MGL * math.sin(0.5))


def test_rubber_hardens() -> None:
    rubber = law("outsider.rubber", {"stiffness": 5.0, "reference": 0.1})
    rubber.bind(pendulum())
    assert rubber.joint(0.6, 0.3, 0.0) == pytest.approx(-5.0 * 0.5**3)  # type: ignore[attr-defined]
    u = rest(rubber, u=0.9)
    assert KP * (0.9 - u) - 5.0 * (u - 0.1) ** 3 == pytest.approx(MGL * math.sin(u), abs=2e-4)


def test_a_strap_is_a_spring_that_lets_go() -> None:
    strap, plant = law("outsider.strap", {"stiffness": 8.0, "time_constant": 0.2}), pendulum()
    strap.bind(plant)
    # drawn at a steady speed it settles at stiffness·time_constant·v, then lets go
    drawn = [strap.joint(0.0, 0.5, 0.0) for _ in range(round(2.0 / plant.h))]  # type: ignore[attr-defined]
    assert drawn[0] == pytest.approx(-8.0 * 0.5 * plant.h, rel=1e-3)
    assert drawn[-1] == pytest.approx(-8.0 * 0.2 * 0.5, rel=1e-3)
    held = [strap.joint(0.0, 0.0, 0.0) for _ in range(round(0.2 / plant.h))]  # type: ignore[attr-defined]
    assert held[-1] == pytest.approx(drawn[-1] * math.exp(-1.0), rel=1e-3)


def test_slosh_swings_on_at_its_own_frequency() -> None:
    parameters: Parameters = {"inertia": 0.05, "frequency": 12.0, "damping": 0.0}
    slosh, plant = law("outsider.slosh", parameters), pendulum()
    slosh.bind(plant)
    slosh.joint(0.0, 0.0, 0.0)  # type: ignore[attr-defined]
    slosh._x = 0.1  # type: ignore[attr-defined]
    t = np.arange(round(2.0 / plant.h)) * plant.h
    torque = np.array([slosh.joint(0.0, 0.0, 0.0) for _ in t])  # type: ignore[attr-defined]
    expected = 0.05 * 12.0**2 * 0.1 * np.cos(12.0 * t)
    np.testing.assert_allclose(torque, expected, atol=0.01 * expected.max())


def test_unbalance_keeps_its_own_pace() -> None:
    parameters: Parameters = {"torque": 0.4, "frequency": 9.0, "phase": 0.2}
    shake = law("outsider.unbalance", parameters)
    plant = pendulum(shake)
    for t in (0.0, 0.13, 1.7):
        plant.total[:] = 0.0
        shake.act(plant, t)  # type: ignore[attr-defined]
        assert plant.total[0] == pytest.approx(0.4 * math.sin(9.0 * t + 0.2))
