"""The cases of each set, decided by a seed and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wt.prove import asked, legged_cases, moving_laws
from wt.prove.case import Case as Case
from wt.prove.case import HiddenEffect as HiddenEffect
from wt.prove.case_spec import CaseSpec
from wt.prove.catalog import parameters
from wt.prove.hidden import Parameters
from wt.prove.legged_rigs import LEGGED
from wt.prove.motions import MOTIONS as ALL_MOTIONS
from wt.prove.obstacles import obstacle
from wt.prove.places import MOTIONS, places
from wt.prove.rigs import RIGS
from wt.prove.sensing import Sensing
from wt.prove.sets import SetName as SetName
from wt.prove.sets import specs


def cases(set: str = "quick", seed: int = 0) -> list[Case]:
    """The cases of a set; the same for the same seed.

    Args:
        set: ``brief`` (10), ``quick`` (30), ``full`` (over 200), ``legged`` (over 100), ``ask``
            (30, which little is recorded of), or one kind of case only.
        seed: decides places, magnitudes, sensing and motions.

    Raises:
        ConfigError: no such set.
    """
    return [
        (legged_cases.draw if spec.rig in LEGGED else _case)(i, spec, seed)
        for i, spec in enumerate(specs(set))
    ]


def _case(index: int, spec: CaseSpec, seed: int) -> Case:
    effects, rig, decoy = spec.effects, spec.rig, spec.decoy
    rng = np.random.default_rng([seed, index, len(effects)])
    motor = RIGS[rig].motor
    quiet = any(effect.startswith(("body.", "world.", "contact.")) for effect in effects)
    sensing = _sensing(rng, motor, decoy, quiet)
    truth = _hidden_effects(spec, sensing.position_noise, rng)
    motions = asked.MOTIONS if spec.asked else _motions(effects[0] if effects else "", rng)
    case = Case(
        name=spec.title(index),
        rig=rig,
        seed=int(rng.integers(2**31)),
        kind=spec.kind,
        truth=truth,
        sensing=sensing,
        motions=motions,
        seconds=float(rng.uniform(14, 18)) if effects != ("actuator.fade",) else 26.0,
        step=0.005 if decoy == "coarse_step" else float(rng.choice([0.001, 0.002])),
        gain=4.0 if decoy == "tight_servo" else 1.0,
        decoy=decoy,
        level=spec.level,
        excused=_excused(rig, rng) if decoy == "wrong_mass" else (),
    )
    if effects == ("contact.obstacle",):
        placed = replace(case.truth[0], parameters=obstacle(case))
        case = replace(case, truth=(placed,))
    return case


def _hidden_effects(
    spec: CaseSpec, noise: float, rng: np.random.Generator
) -> tuple[HiddenEffect, ...]:
    """The effects of a specification, each at a joint or body of its own."""
    truth: list[HiddenEffect] = []
    for effect in spec.effects:
        taken = {_joint(spec.rig, hidden) for hidden in truth}
        free = [joint for joint in places(effect, spec.rig) if joint not in taken]
        joint = int(rng.choice(free))
        seed = int(rng.integers(2**31))
        drawn = parameters(effect, spec.rig, joint, spec.level, noise, seed)
        truth.append(_truth(effect, spec.rig, joint, drawn, rng))
    return tuple(truth)


def _motions(effect: str, rng: np.random.Generator) -> tuple[str, str, str]:
    """Two motions to fit on, which show the first effect, and another held out."""
    first, second = MOTIONS.get(effect, _two(rng))
    others = [motion for motion in ALL_MOTIONS if motion not in (first, second)]
    holdout = str(rng.choice(others + ["mixture"] * 3))
    if effect in ("actuator.saturation", "actuator.slew_rate", "actuator.speed_limit"):
        holdout = "jumps"
    return first, second, holdout


def _excused(rig: str, rng: np.random.Generator) -> tuple[tuple[str, str, str], ...]:
    """The body whose mass is wrong, by more than the few per cent that all are."""
    body = RIGS[rig].bodies[int(rng.choice(places("body.mass", rig)))]
    return tuple((effect, "body", body) for effect in ("body.mass", "body.payload_fixed"))


def _two(rng: np.random.Generator) -> tuple[str, str]:
    first = str(rng.choice(["multisine", "multisine", "triangle", "chirp"]))
    second = str(rng.choice([m for m in ("moves", "jumps", "triangle", "holds") if m != first]))
    return first, second


def _joint(rig: str, truth: HiddenEffect) -> int:
    robot = RIGS[rig]
    name = truth.name.removesuffix("_drive")
    return robot.joints.index(name) if name in robot.joints else robot.bodies.index(name)


def _truth(
    effect: str, rig: str, joint: int, drawn: Parameters, rng: np.random.Generator
) -> HiddenEffect:
    robot = RIGS[rig]
    name, body = robot.joints[joint], robot.bodies[joint]
    group = effect.partition(".")[0]
    if effect == "body.payload_moving":
        law, drawn = moving_laws.variant(drawn, rng)
        return HiddenEffect(effect, "body", body, drawn, law)
    if group == "body":
        return HiddenEffect(effect, "body", body, drawn, effect)
    if group == "actuator":
        return HiddenEffect(effect, "actuator", f"{name}_drive", drawn, effect)
    if effect == "world.gravity_compensation":
        return HiddenEffect(effect, "body", "all", drawn, effect)
    if group == "pair":
        return HiddenEffect(effect, "pair", f"{robot.joints[joint - 1]}+{name}", drawn, effect)
    if group in ("world", "contact"):
        return HiddenEffect(effect, "world", "world", drawn, effect)
    if effect == "sensor.delay" and rng.random() < 0.5:
        return HiddenEffect(effect, "sensor", "all", drawn, effect)
    if effect == "outsider.flywheel":
        moved = tuple(("joint", j) for j in robot.joints[: joint + 1])
        return HiddenEffect("unknown", "body", body, drawn, effect, accept=moved)
    if effect == "outsider.cable":
        other = robot.joints[joint - 1]
        either = (("joint", other), ("joint", name), ("pair", f"{name}+{other}"))
        return HiddenEffect("unknown", "pair", f"{other}+{name}", drawn, effect, accept=either)
    if group == "outsider":
        return HiddenEffect("unknown", "joint", name, drawn, effect)
    return HiddenEffect(effect, "joint", name, drawn, effect)


def _sensing(rng: np.random.Generator, motor: bool, decoy: str, quiet: bool) -> Sensing:
    """Quiet: for effects on bodies, which stiff servos all but hide in their small errors."""
    rate = float(rng.choice([200, 500] if motor else [50, 100, 100, 200, 200, 500]))
    bits = int(rng.integers(14 if quiet else 12, 18))
    step = 2 * np.pi / 2**bits
    noise = min(step * float(10 ** rng.uniform(-1.0, 1.0)), 1.5e-4 if quiet else 6e-4)
    jitter = float(rng.choice([0.0, 0.0, 0.02, 0.06]))
    drops = float(rng.choice([0.0, 0.0, 0.005, 0.02]))
    return Sensing(
        rate=rate,
        bits=bits,
        noise=noise,
        colour=float(rng.uniform(0.6, 0.9)) if decoy == "coloured_noise" else 0.0,
        jitter=jitter,
        clock="loop" if rng.random() < 0.4 else "stamps",
        drops=drops,
        missing="nan" if rng.random() < 0.5 else "rows",
        qvel=str(rng.choice(["none", "noisy", "noisy", "filtered"])),  # type: ignore[arg-type]
        qvel_noise=float(10 ** rng.uniform(-2.5, -1.7)),
        gyro=bool(rng.random() < 0.2),
    )
