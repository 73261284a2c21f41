"""What every effect must keep to, whoever added it."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.physics.arm import ARM, Run, edited, motion, scene, simulate
from tests.physics.contradictions import CONTRADICTIONS
from tests.physics.truths import TRUTHS, Truth
from wt.physics.effect import Effect, effects
from wt.physics.hooks import Linearised
from wt.physics.planted import Planted
from wt.physics.scene import Scene
from wt.types import Location

# The published table of effects: id → (parameter, unit).
TABLE = {
    "joint.friction_coulomb": [("coulomb", "N·m")],
    "joint.friction_viscous": [("coefficient", "N·m·s/rad")],
    "joint.friction_quadratic": [("coefficient", "N·m·s²/rad²")],
    "joint.friction_stribeck": [("coulomb", "N·m"), ("static", "N·m"), ("velocity", "rad/s")],
    "joint.friction_load": [("coulomb", "N·m"), ("fraction", "-")],
    "joint.gear_loss": [
        ("drive", "-"),
        ("back", "-"),
        ("coulomb", "N·m"),
        ("viscous", "N·m·s/rad"),
    ],
    "joint.stiffness": [("stiffness", "N·m/rad"), ("reference", "rad")],
    "joint.armature": [("inertia", "kg·m²")],
    "joint.backlash": [("gap", "rad")],
    "joint.elasticity": [("stiffness", "N·m/rad"), ("damping", "N·m·s/rad")],
    "joint.hysteresis": [("stiffness", "N·m/rad"), ("yield", "N·m")],
    "joint.stop": [("position", "rad"), ("side", "±1")],
    "actuator.gain": [("factor", "-")],
    "actuator.damping": [("factor", "-")],
    "actuator.feedforward": [("coefficient", "N·m·s/rad")],
    "actuator.integral": [("ki", "N·m/(rad·s)")],
    "actuator.slew_rate": [("speed", "rad/s")],
    "actuator.profile": [("speed", "rad/s"), ("acceleration", "rad/s²")],
    "actuator.bias": [("torque", "N·m")],
    "actuator.delay": [("delay", "s")],
    "actuator.lag": [("time_constant", "s")],
    "actuator.saturation": [("torque", "N·m")],
    "actuator.speed_limit": [("stall", "N·m"), ("speed", "rad/s")],
    "actuator.deadband": [("width", "N·m")],
    "actuator.ripple": [("amplitude", "N·m"), ("cycles", "1/rev"), ("phase", "rad")],
    "actuator.fade": [("loss", "-"), ("time_constant", "s")],
    "body.mass": [("factor", "-")],
    "body.com": [("shift", "m")],
    "body.inertia": [("factor", "-")],
    "body.payload_fixed": [("mass", "kg"), ("position", "m")],
    "body.payload_moving": [("mass", "kg"), ("travel", "m"), ("position", "m")],
    "body.force": [("force", "N")],
    "body.force_intermittent": [("force", "N")],
    "body.drag": [("coefficient", "N·s²/m²")],
    "body.tether": [("stiffness", "N/m"), ("anchor", "m")],
    "sensor.offset": [("offset", "rad")],
    "sensor.scale": [("factor", "-")],
    "sensor.delay": [("delay", "s")],
    "sensor.quantization": [("step", "rad")],
    "world.gravity": [("angle", "rad"), ("direction", "rad")],
    "world.gravity_compensation": [("share", "-")],
    "joint.friction_directional": [
        ("coulomb_forward", "N·m"),
        ("coulomb_backward", "N·m"),
        ("viscous_forward", "N·m·s/rad"),
        ("viscous_backward", "N·m·s/rad"),
    ],
    "joint.friction_position": [
        ("coulomb", "N·m"),
        ("depth", "-"),
        ("wavelength", "rad"),
        ("phase", "rad"),
    ],
    "joint.force_intermittent": [("torque", "N·m")],
    "pair.crosstalk": [("fraction", "-")],
    "pair.spring": [("stiffness", "N·m/rad"), ("ratio", "-"), ("reference", "rad")],
    "contact.compliance": [("time_constant", "s")],
    "contact.friction": [("friction", "-")],
    "contact.obstacle": [("position", "m"), ("normal", "-"), ("friction", "-")],
    "contact.slope": [("angle", "rad"), ("direction", "rad"), ("height", "m")],
}
# Nothing of these, and what they would be without it, are one model with more parts.
WITHOUT = ("joint.backlash",)
# Nothing of these is more than any machine has.
ENDLESS = (
    "actuator.profile", "actuator.saturation", "actuator.slew_rate", "actuator.speed_limit",
    "body.payload_fixed", "body.payload_moving",
    "body.tether", "contact.compliance", "contact.friction", "contact.obstacle",
    "joint.elasticity", "joint.stop",
)  # fmt: skip
IDS = pytest.mark.parametrize("name", effects())
PUBLISHED = pytest.mark.parametrize("name", TABLE)
# Far below the arm, so that every effect has a place to stand at.
FLOOR = '<worldbody><geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -2"/>'


@pytest.fixture(scope="module")
def recorded() -> Run:
    return simulate(ARM, seconds=0.2)


@pytest.fixture
def arm(tmp_path: Path) -> Scene:
    return scene(tmp_path, ARM.replace("<worldbody>", FLOOR))


def acceleration(model: mujoco.MjModel) -> np.ndarray:
    """Accelerations of the arm's joints at some state, whatever else the model has."""
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in ("j0", "j1", "j2")]
    for joint, q, v in zip(joints, (0.3, -0.2, 0.5), (1.0, -2.0, 0.7), strict=True):
        data.joint(joint.id).qpos, data.joint(joint.id).qvel = q, v
    data.ctrl[:3] = 0.2, 0.1, -0.3
    mujoco.mj_forward(model, data)
    return np.array([data.qacc[joint.dofadr[0]] for joint in joints])


def test_what_is_published_is_there() -> None:
    assert set(TABLE) <= set(effects())


@PUBLISHED
def test_names_and_units_are_those_of_the_table(name: str) -> None:
    assert [(p.name, p.unit) for p in effects()[name].parameters if p.public] == TABLE[name]


@IDS
def test_parameters_have_bounds_and_steps(name: str) -> None:
    effect = effects()[name]
    lower, upper = effect.bounds()
    assert len(lower) == len(upper) == len(effect.steps()) == effect.n_theta
    assert (lower < upper).all()
    assert (effect.steps() >= 0.0).all()


@IDS
def test_signatures_fit_the_motion(name: str, arm: Scene, recorded: Run) -> None:
    effect, moved = effects()[name], motion(arm, recorded)
    places = effect.places(arm)
    assert places
    for at in places:
        for shape in effect.shapes(moved, at)[:2]:
            columns = effect.columns(moved, at, shape)
            assert columns.shape[:2] == moved.q.shape
            assert np.isfinite(columns).all()
            assert not effect.signed or len(effect.signed) == columns.shape[2]
            theta = effect.theta(np.full(columns.shape[2], 0.1), shape)
            assert np.shape(theta) == (effect.n_theta,)
        smaller = {"joint.friction_coulomb": [0.2], "body.payload_fixed": [0.2, 0.0, 0.0, 0.0]}
        found = [Planted(effects()[law], at, np.array(x)) for law, x in smaller.items()]
        larger = [theta for one in found for _, theta in one.beyond(effect, moved)]
        for start in (*effect.starts(moved, at), *larger):
            lower, upper = effect.bounds()
            assert ((lower <= start) & (start <= upper)).all()


WEIGHTS = re.compile(r'(mass|armature|diaginertia|gainprm|biasprm)="([^"]*)"')


def weighing(factor: float) -> str:
    """The arm with a link too light and all masses, and what its drives do, times a factor."""

    def scaled(attribute: re.Match[str]) -> str:
        values = [factor * float(value) for value in attribute[2].split()]
        return f'{attribute[1]}="{" ".join(map(repr, values))}"'

    return WEIGHTS.sub(scaled, edited(('mass="0.8"', 'mass="0.4"'), ("<worldbody>", FLOOR)))


@IDS
def test_a_search_begins_in_proportion_to_the_machine(
    name: str, recorded: Run, tmp_path: Path
) -> None:
    factor = 1e-6
    effect = effects()[name]
    light, usual = tmp_path / "light", tmp_path / "usual"
    light.mkdir()
    usual.mkdir()
    moved, other = (
        motion(scene(folder, weighing(f)), recorded)
        for folder, f in ((usual, 1.0), (light, factor))
    )
    lower, upper = effect.bounds()
    weighty = [any(u in p.unit for u in ("N", "kg")) for p in effect.parameters]
    scale = np.repeat(np.where(weighty, factor, 1.0), [p.size for p in effect.parameters])
    for at in effect.places(moved.scene):
        assert len(effect.shapes(other, at)) == len(effect.shapes(moved, at))
        starts = list(effect.starts(moved, at))
        for mine, theirs in zip(effect.starts(other, at), starts, strict=True):
            assert mine == pytest.approx(theirs * scale, rel=1e-3)
            assert ((lower <= mine) & (mine <= upper)).all()


def declared(name: str) -> list[float | None]:
    return [p.neutral for p in effects()[name].parameters for _ in range(p.size)]


def test_every_effect_says_where_it_is_nothing_if_it_ever_is() -> None:
    endless = {name for name in effects() if not any(n is not None for n in declared(name))}
    assert endless == set(ENDLESS)


@pytest.mark.parametrize("name", sorted(set(effects()) - set(WITHOUT) - set(ENDLESS)))
def test_neutral_parameters_change_nothing(name: str, arm: Scene) -> None:
    effect = effects()[name]
    given = next((t.theta for t in TRUTHS if t.id == name), np.ones(effect.n_theta))
    theta = [g if n is None else n for g, n in zip(given, declared(name), strict=True)]
    before = acceleration(arm.spec().compile())
    for at in effect.places(arm):
        spec = arm.spec()
        effect.patch(spec, at, np.array(theta))
        assert acceleration(spec.compile()) == pytest.approx(before, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", [e.id for e in effects().values() if isinstance(e, Linearised)])
def test_where_products_count_it_is_products_that_move(name: str) -> None:
    effect, rng = effects()[name], np.random.default_rng(0)
    theta, step = rng.uniform(0.5, 1.5, (2, effect.n_theta))
    step[1:] *= -1.0
    # the first parameter's own step, and that of each product by the product rule
    first, others = theta[0] + step[0], theta[0] * theta[1:]
    others = others + theta[0] * step[1:] + step[0] * theta[1:]
    assert isinstance(effect, Linearised)
    moved = effect.moved(theta, step)
    assert moved[0] == pytest.approx(first)
    assert moved[0] * moved[1:] == pytest.approx(others)
    lower, upper = effect.bounds()
    assert (effect.moved(theta, np.full(len(theta), -1e9)) >= lower).all()
    assert (effect.moved(theta, np.full(len(theta), 1e9)) <= upper).all()


def test_what_a_recording_can_rule_out_has_an_example() -> None:
    said = {n for n, e in effects().items() if type(e).contradiction is not Effect.contradiction}
    assert said == set(CONTRADICTIONS)


@pytest.mark.parametrize("name", sorted(CONTRADICTIONS))
def test_a_recording_rules_out_what_it_shows_to_be_otherwise(
    name: str, arm: Scene, recorded: Run
) -> None:
    example, moved = CONTRADICTIONS[name], motion(arm, recorded)
    ruled_out = Planted(effects()[name], example.at, np.array(example.impossible(moved)))
    said = effects()[name].contradiction(moved, example.at, ruled_out.theta)
    assert said and not said.endswith(".")
    assert not ruled_out.possible(moved)
    fine = np.array(example.possible(moved))
    assert effects()[name].contradiction(moved, example.at, fine) is None


def test_noise_passes_no_limit(arm: Scene, recorded: Run) -> None:
    """A light wrist's motion took 1.8 N·m for 1 % of the time, of which 1.2 were its drive's."""
    moved, at = motion(arm, recorded), Location("actuator", "m1")
    dof, saturation = arm.drive("m1").dof, effects()["actuator.saturation"]
    most = float(np.abs(moved.demand[:, dof]).max())
    noise = 0.5 * most * np.random.default_rng(0).standard_normal(len(moved))
    moved.__dict__["demand"] = moved.demand + noise[:, None]
    assert np.quantile(np.abs(moved.demand[:, dof]), 0.99) > 1.5 * 0.8 * most
    assert saturation.contradiction(moved, at, np.array([0.8 * most])) is None
    assert saturation.contradiction(moved, at, np.array([0.3 * most]))


def test_a_ripple_is_seen_to_come_again(arm: Scene, recorded: Run) -> None:
    """Of less than a wave nobody can tell that it is one; of little more, held-out data do."""
    moved, at = motion(arm, recorded), Location("actuator", "m1")
    turns = float(np.ptp(moved.q[:, arm.drive("m1").dof])) / (2.0 * np.pi)
    ripple = effects()["actuator.ripple"]
    assert not ripple.plausible(moved, at, np.array([0.5, 0.9 / turns, 0.0]))
    assert ripple.plausible(moved, at, np.array([0.5, max(1.5 / turns, 3.0), 0.0]))
    assert all(shape[0] * turns >= 1.0 for shape in ripple.shapes(moved, at))


def test_friction_along_the_way_is_a_wave_of_which_something_is_seen(
    arm: Scene, recorded: Run
) -> None:
    """Of a longer one any mean will do: a calf was said to lose up to 31 N·m to friction."""
    moved, at = motion(arm, recorded), Location("joint", "j1")
    way = float(np.ptp(moved.q[:, arm.dof("j1")]))
    friction = effects()["joint.friction_position"]
    assert friction.plausible(moved, at, np.array([1.0, 0.8, 3.0 * way, 0.0]))
    assert not friction.plausible(moved, at, np.array([15.8, 0.98, 15.0 * way, 0.0]))
    assert all(shape[0] < 3.5 * way for shape in friction.shapes(moved, at))


def test_a_stop_yields_to_what_presses_on_it(arm: Scene, recorded: Run) -> None:
    moved, stop = motion(arm, recorded), effects()["joint.stop"]
    dof, at = arm.dof("j1"), Location("joint", "j1")
    farthest = float(moved.q[:, dof].max())
    entered = np.array([farthest - 0.06, 1.0])
    assert stop.contradiction(moved, at, entered)
    # held back there by a force that would have given it 600 rad/s²
    held = np.zeros_like(moved.q)
    held[moved.q[:, dof] > farthest - 0.06, dof] = 600.0 * arm.model.dof_M0[dof]
    assert stop.contradiction(moved.without(held), at, entered) is None
    assert stop.contradiction(moved.without(held), at, entered - [0.1, 0.0])


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.id}-{t.at.name}")
def test_patched_files_load_in_plain_mujoco(truth: Truth, tmp_path: Path) -> None:
    effect, spec = effects()[truth.id], scene(tmp_path, truth.model).spec()
    effect.patch(spec, truth.at, np.array(truth.theta))
    model = spec.compile()
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert again.nu == 3
    assert [again.actuator(i).name for i in range(3)] == ["m0", "m1", "m2"]
    # numbers in a file have six digits
    assert acceleration(again) == pytest.approx(acceleration(model), rel=1e-4)
    assert again.body_mass.sum() == pytest.approx(model.body_mass.sum(), rel=1e-5)


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.id}-{t.at.name}")
def test_people_are_told(truth: Truth) -> None:
    effect: Effect = effects()[truth.id]
    theta = np.array(truth.theta)
    said = effect.statement(truth.at, theta)
    assert all(name in said for name in truth.at.name.split("+")) or truth.at.kind == "world"
    assert effect.statement(truth.at, theta).endswith(".")
    assert effect.separation(truth.at)
    assert effect.reference
    assert set(effect.named(theta)) >= {p.name for p in effect.parameters}


def test_angles_of_a_file_in_degrees_stay_right(tmp_path: Path) -> None:
    text = ARM.replace('<compiler angle="radian"/>', '<compiler angle="degree"/>')
    spec = scene(tmp_path, text).spec()
    at = Location("joint", "j1")
    effects()["joint.stiffness"].patch(spec, at, np.array([2.0, 0.4]))
    effects()["joint.stop"].patch(spec, at, np.array([0.3, 1.0]))
    model = spec.compile()
    assert model.joint("j1").qpos_spring[0] == pytest.approx(0.4)
    assert model.joint("j1").range[1] == pytest.approx(0.3)


@pytest.mark.parametrize("name", ["actuator.gain", "body.mass", "body.payload_fixed"])
def test_a_servo_keeps_its_damping_when_given_as_a_ratio(name: str, tmp_path: Path) -> None:
    servo = '<position name="m1" joint="j1" kp="60" dampratio="1"/>'
    own = '<general name="m1" joint="j1" gainprm="60" biastype="affine" biasprm="0 -60 -3"/>'
    arm = scene(tmp_path, ARM.replace(own, servo))
    damping = arm.model.actuator("m1").biasprm[2]
    at = Location("actuator", "m1") if name == "actuator.gain" else Location("body", "b2")
    theta = np.array([2.0, 0.1, 0.0, 0.0])[: effects()[name].n_theta]
    spec = arm.spec()
    effects()[name].patch(spec, at, theta)
    factor = 2.0 if name == "actuator.gain" else 1.0
    assert spec.compile().actuator("m1").biasprm[2] == pytest.approx(factor * damping)
