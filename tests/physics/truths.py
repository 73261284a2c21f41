"""For every effect a machine that has it: MJCF written by hand, or the law in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.physics.arm import ARM, Hook, Run, edited, simulate
from tests.physics.laws import (
    B2,
    BEFORE_TABLE,
    FALLING,
    G1,
    G2,
    INERTIAL,
    J1,
    LEVEL,
    LINK_ONLY,
    M1,
    TILT,
    ahead,
    along,
    belted,
    carried,
    carrying,
    constant,
    directed,
    dragged,
    filtered,
    floored,
    instead,
    joint,
    late,
    later,
    leaking,
    leaning,
    load,
    lossy,
    nudged,
    planned,
    play,
    play_operator,
    push,
    pushed,
    scaled,
    shifted,
    sliding,
    slow,
    stepped,
    stribeck,
    tethered,
    two_masses,
)
from wt.physics.effect import effects
from wt.types import Location


@dataclass(frozen=True)
class Truth:
    """An effect, where it is, and a machine that has it.

    Attributes:
        xml: the machine; the arm as it is, if empty.
        hook: acts in its simulation.
        sensed: makes of its true motion what is recorded of it.
        model: the machine as the model has it.
        fits: tolerance of the parameters from the signature; None without a signature.
        shape: shape of the signature.
        leaves: largest share of the residual that the signature may leave.
        replays: largest error of a replay, as a share of what the effect does.
    """

    id: str
    at: Location
    theta: tuple[float, ...]
    xml: str = ""
    hook: Callable[[], Hook] | None = None
    sensed: Callable[[Run], Run] | None = None
    model: str = ARM
    fits: float | None = 0.02
    shape: tuple[float, ...] = ()
    leaves: float = 0.15
    replays: float = 0.02

    def machine(self) -> Run:
        """A recording of the machine that has it."""
        run = simulate(self.xml or self.model, self.hook() if self.hook else None)
        return self.sensed(run) if self.sensed else run


def untold(truths: Sequence[Truth]) -> set[str]:
    """Ids of effects of which there is no truth."""
    return set(effects()) - {truth.id for truth in truths}


def _at(kind: str, name: str) -> Location:
    return Location(kind, name)  # type: ignore[arg-type]


TRUTHS = [
    Truth(
        "joint.friction_coulomb",
        _at("joint", "j1"),
        (0.5,),
        # stiff, as dry friction is: MuJoCo's default lets a joint at rest creep
        joint(
            'frictionloss="0.5" solreffriction="0.002 1" solimpfriction="0.999 0.9999 0.001 0.5 2"'
        ),
        fits=0.1,
        leaves=0.4,
    ),
    Truth("joint.friction_viscous", _at("joint", "j1"), (0.4,), joint('damping="0.4"')),
    Truth("joint.friction_quadratic", _at("joint", "j1"), (0.3,), joint('damping="0 0.3"')),
    Truth(
        "joint.friction_stribeck",
        _at("joint", "j1"),
        (0.8, 1.4, 0.3),
        hook=push(stribeck),
        shape=(0.3,),
        fits=0.04,
        replays=0.1,
    ),
    Truth(
        "joint.friction_load",
        _at("joint", "j1"),
        (0.3, 0.2),
        hook=push(load),
        fits=0.04,
        replays=0.1,
    ),
    Truth(
        "joint.gear_loss",
        _at("joint", "j1"),
        (0.1, 0.35, 0.3, 0.2),
        hook=push(lossy),
        fits=0.06,
        replays=0.1,
    ),
    Truth(
        "joint.friction_directional",
        _at("joint", "j1"),
        (0.5, 0.9, 0.2, 0.6),
        hook=push(directed),
        fits=0.06,
        replays=0.1,
    ),
    Truth(  # in the place of friction that the model has the same both ways
        "joint.friction_directional",
        _at("joint", "j1"),
        (0.5, 0.9, 0.2, 0.6),
        ARM,
        hook=push(directed),
        model=joint(
            'damping="0.4" frictionloss="0.7" solreffriction="0.002 1" '
            'solimpfriction="0.999 0.9999 0.001 0.5 2"'
        ),
        shape=(0.7, 0.4),
        fits=0.06,
        replays=0.1,
    ),
    Truth(
        "joint.friction_position",
        _at("joint", "j1"),
        (0.8, 0.6, np.pi / 2.0, 0.5),
        hook=push(along),
        shape=(np.pi / 2.0,),
        fits=0.06,
        replays=0.1,
    ),
    Truth("pair.crosstalk", _at("pair", "j1+j2"), (-0.2,), hook=lambda: leaking()),
    Truth("pair.spring", _at("pair", "j1+j2"), (6.0, -0.8, 0.3), hook=belted, shape=(-0.8,)),
    Truth("world.gravity_compensation", _at("body", "all"), (0.7,), hook=carried),
    Truth(
        "joint.stiffness", _at("joint", "j1"), (2.0, 0.4), joint('stiffness="2" springref="0.4"')
    ),
    Truth(
        "joint.armature",
        _at("joint", "j1"),
        (0.05,),
        edited((J1, 'name="j1" axis="0 1 0" armature="0.07"')),
    ),
    Truth(
        "joint.backlash",
        _at("joint", "j1"),
        (0.04, 0.0),
        LINK_ONLY,
        hook=two_masses(play),
        fits=None,
        replays=0.15,
    ),
    Truth(
        "joint.elasticity",
        _at("joint", "j1"),
        (150.0, 0.5, 0.0),
        LINK_ONLY,
        hook=two_masses(lambda x, r: 150.0 * x + 0.5 * r),
        fits=None,
        replays=0.05,
    ),
    Truth(
        "joint.hysteresis",
        _at("joint", "j1"),
        (12.0, 1.2),
        hook=play_operator,
        shape=(0.1,),
        replays=0.05,
    ),
    Truth(
        "joint.stop",
        _at("joint", "j1"),
        (0.3, 1.0),
        joint('range="-9 0.3" limited="true" solreflimit="0.005 1"'),
        fits=None,
        replays=0.1,
    ),
    Truth(
        "actuator.gain",
        _at("actuator", "m1"),
        (0.8,),
        edited((M1, 'gainprm="48" biastype="affine" biasprm="0 -48 -2.4"')),
    ),
    Truth(
        "actuator.damping",
        _at("actuator", "m1"),
        (0.4,),
        edited((M1, 'gainprm="60" biastype="affine" biasprm="0 -60 -1.2"')),
    ),
    Truth(
        "actuator.feedforward",
        _at("actuator", "m1"),
        (2.0, 0.0025),
        hook=lambda: ahead(),
        shape=(0.0025,),
    ),
    Truth("actuator.integral", _at("actuator", "m1"), (40.0,), hook=lambda: leaning()),
    Truth(
        "actuator.slew_rate",
        _at("actuator", "m1"),
        (0.8,),
        hook=lambda: slow(),
        shape=(0.8,),
    ),
    Truth(
        "actuator.profile",
        _at("actuator", "m1"),
        (0.9, 6.0),
        hook=lambda: planned(),
        shape=(0.9, 6.0),
    ),
    Truth("actuator.bias", _at("actuator", "m1"), (0.7,), hook=push(lambda d: 0.7)),
    Truth(
        "actuator.delay",
        _at("actuator", "m1"),
        (0.012,),
        hook=lambda: late(),
        shape=(0.012,),
        fits=0.04,
        replays=0.05,
    ),
    Truth(
        "actuator.delay",
        _at("actuator", "all"),
        (0.012,),
        hook=lambda: late(slice(None)),
        shape=(0.012,),
        fits=0.04,
        replays=0.05,
    ),
    Truth(
        "actuator.lag",
        _at("actuator", "m1"),
        (0.02,),
        hook=lambda: filtered(),
        shape=(0.02,),
        fits=0.04,
        replays=0.05,
    ),
    Truth(
        "actuator.saturation",
        _at("actuator", "m1"),
        (4.0,),
        edited((M1, f'{M1} forcelimited="true" forcerange="-4 4"')),
        shape=(4.0,),
    ),
    Truth(
        "actuator.speed_limit",
        _at("actuator", "m1"),
        (8.0, 3.0),
        hook=instead(
            lambda f, d: float(np.clip(f, -8 * (1 + d.qvel[1] / 3), 8 * (1 - d.qvel[1] / 3)))
        ),
        shape=(8.0, 3.0),
    ),
    Truth(
        "actuator.deadband",
        _at("actuator", "m1"),
        (1.5,),
        hook=instead(lambda f, d: float(np.sign(f) * max(abs(f) - 1.5, 0.0))),
        shape=(1.5,),
    ),
    Truth(
        "actuator.ripple",
        _at("actuator", "m1"),
        (0.6, 9.0, 0.8),
        hook=push(lambda d: 0.6 * np.sin(9 * d.qpos[1] + 0.8)),
        shape=(9.0,),
    ),
    Truth(
        "actuator.fade",
        _at("actuator", "m1"),
        (0.4, 1.0),
        hook=instead(lambda f, d: f * (1 - 0.4 * (1 - np.exp(-d.time / 1.0)))),
        shape=(1.0, 0.0),  # the load is the usual one all the time
    ),
    Truth("body.mass", _at("body", "b2"), (1.5,), edited((B2, 'mass="1.2"'))),
    Truth(
        "body.mass",
        _at("body", "b1"),
        (1.5,),
        edited(
            (
                INERTIAL,
                '<inertial pos="0.15 0.01 0.02" mass="1.8" diaginertia="0.006 0.018 0.0165"/>',
            )
        ),
    ),
    Truth(
        "body.com",
        _at("body", "b1"),
        (0.02, 0.01, -0.015),
        edited((INERTIAL, INERTIAL.replace("0.15 0.01 0.02", "0.17 0.02 0.005"))),
        fits=0.12,
    ),
    Truth(
        "body.inertia",
        _at("body", "b1"),
        (3.0,),
        edited((INERTIAL, INERTIAL.replace("0.004 0.012 0.011", "0.012 0.036 0.033"))),
    ),
    Truth(
        "body.payload_fixed",
        _at("body", "b2"),
        (0.5, 0.1, 0.04, 0.05),
        carrying(G2, "0.1 0.04 0.05"),
        fits=0.3,
    ),
    Truth(
        "body.payload_fixed",
        _at("body", "b1"),
        (0.5, 0.1, 0.04, 0.05),
        carrying(G1, "0.1 0.04 0.05"),
        fits=0.3,
    ),
    Truth(
        "body.payload_moving",
        _at("body", "b2"),
        (0.5, 0.3, 0.1, 0.04, 0.05),
        # a spring keeps it off the stops, whose blows are too short for a least squares fit
        sliding(G2, "0.1 0.04 0.05", 0.15, 10.0, 72.0),
        shape=(0.3, 0.0, 0.0, 20.0, 144.0, 0.0, 0.1, 0.04, 0.05, 0.5),
        replays=0.05,
    ),
    Truth("body.force", _at("body", "b2"), (3.0, -2.0, 4.0), hook=constant),
    Truth("body.drag", _at("body", "b2"), (2.5,), hook=dragged),
    Truth("body.tether", _at("body", "b3"), (20.0, 0.2, 0.3, 0.9), hook=tethered),
    Truth(
        "world.gravity",
        _at("world", "world"),
        (0.1, 0.7),
        edited(('gravity="0 0 -9.81"', f'gravity="{TILT[0]} {TILT[1]} {TILT[2]}"')),
    ),
    Truth(
        "body.force_intermittent",
        _at("body", "b2"),
        (3.0, -2.0, 4.0),
        hook=pushed,
        shape=(0.0, 0.8, 1.1),
    ),
    Truth(
        "joint.force_intermittent",
        _at("joint", "j1"),
        (2.0,),
        hook=nudged,
        shape=(0.0, 0.8, 1.1, 0.05, 1.0),
    ),
    Truth("sensor.offset", _at("joint", "j1"), (0.02,), sensed=shifted(0.02), fits=0.04),
    Truth("sensor.scale", _at("joint", "j1"), (1.03,), sensed=scaled(1.03), fits=0.04),
    Truth(
        "sensor.delay",
        _at("joint", "j1"),
        (0.004,),
        sensed=later(0.004),
        shape=(0.004,),
        fits=0.04,
        replays=0.05,
    ),
    Truth("sensor.quantization", _at("joint", "j1"), (0.01,), sensed=stepped(0.01), fits=None),
    Truth(
        "contact.obstacle",
        _at("world", "world"),
        (0.3, 0.0, LEVEL, 0.0, 0.0, 1.0, 0.3),
        # a box, while the effect's own has its face turned into place
        BEFORE_TABLE,
        fits=None,
        replays=0.15,
    ),
    Truth(
        "contact.friction",
        _at("geom", "floor"),
        (0.2,),
        floored(friction="0.2"),
        model=floored(),
        fits=None,
        replays=0.05,
    ),
    Truth(
        "contact.compliance",
        _at("geom", "floor"),
        (0.08,),
        floored(solref="0.08 1"),
        model=floored(),
        fits=None,
        replays=0.05,
    ),
    Truth(
        "contact.slope",
        _at("geom", "floor"),
        (0.2, 0.7, 0.03),
        floored(zaxis=" ".join(f"{x:.9f}" for x in FALLING), height=LEVEL + 0.03),
        model=floored(),
        fits=None,
        replays=0.05,
    ),
]
