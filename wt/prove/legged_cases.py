"""The cases of robots with legs; :mod:`wt.prove.cases` has those of all others."""

from __future__ import annotations

import numpy as np

from wt.prove import legged_motions, moving_laws
from wt.prove.base_sensing import BaseSensing
from wt.prove.case import Case, HiddenEffect
from wt.prove.case_spec import CaseSpec
from wt.prove.hidden import Parameters
from wt.prove.legged_catalog import MOTIONS, parameters, places
from wt.prove.legged_rigs import LEGGED
from wt.prove.sensing import Sensing

_STEPPING = ("trot", "walk", "paw")


def draw(index: int, spec: CaseSpec, seed: int) -> Case:
    """One case.

    Args:
        index: of the specification in its set.
        spec: the specification.
        seed: decides places, magnitudes, sensing and motions.
    """
    effects, rig, level, decoy = spec.effects, spec.rig, spec.level, spec.decoy
    rng = np.random.default_rng([seed, index, len(effects), 6])
    sensing = _sensing(rng, decoy)
    truth: list[HiddenEffect] = []
    for effect in effects:
        free = [place for place in places(effect, rig) if place not in {t.name for t in truth}]
        place = str(rng.choice(free))
        noise = sensing.position_noise
        drawn = parameters(effect, rig, place, level, noise, int(rng.integers(2**31)))
        truth.append(_truth(effect, rig, place, drawn, rng))
    return Case(
        name=spec.title(index),
        rig=rig,
        seed=int(rng.integers(2**31)),
        kind=spec.kind,
        truth=tuple(truth),
        sensing=sensing,
        motions=_motions(rng, rig, effects[0] if effects else ""),
        seconds=float(rng.uniform(13, 18)) if effects != ("actuator.fade",) else 20.0,
        step=0.004 if decoy == "coarse_step" else float(rng.choice([0.001, 0.002])),
        decoy=decoy,
        level=level,
    )


def _motions(rng: np.random.Generator, rig: str, effect: str) -> tuple[str, str, str]:
    """Two to fit on, of which a quadruped's second one has steps, and another held out."""
    kinds = legged_motions.MOTIONS[rig]
    on_the_spot = [kind for kind in kinds if kind not in _STEPPING]
    first = str(rng.choice(on_the_spot))
    others = [kind for kind in kinds if kind in _STEPPING] or on_the_spot
    second = str(rng.choice([kind for kind in others if kind != first]))
    if effect in MOTIONS:
        first, second = MOTIONS[effect][rig]
    holdout = str(rng.choice([kind for kind in kinds if kind not in (first, second)]))
    return first, second, holdout


def _truth(
    effect: str, rig: str, place: str, drawn: Parameters, rng: np.random.Generator
) -> HiddenEffect:
    robot, group = LEGGED[rig], effect.partition(".")[0]
    if effect == "body.payload_moving":
        law, drawn = moving_laws.variant(drawn, rng)
        return HiddenEffect(effect, "body", place, drawn, law)
    if group == "actuator":
        return HiddenEffect(effect, "actuator", f"{place}_drive", drawn, effect)
    if group == "joint":
        return HiddenEffect(effect, "joint", place, drawn, effect)
    if group == "body":
        return HiddenEffect(effect, "body", place, drawn, effect)
    if group == "contact":
        return HiddenEffect(effect, "geom", place, drawn, effect)
    if place in robot.joints:
        return HiddenEffect("unknown", "joint", place, drawn, effect)
    if place in robot.bodies:
        return HiddenEffect("unknown", "body", place, drawn, effect)
    # the foot, its link, or a joint of its leg are as right
    body = next(foot.body for foot in robot.feet if foot.name == place)
    accept = (("body", body), *(("joint", joint) for joint in robot.leg(place)))
    return HiddenEffect("unknown", "geom", place, drawn, effect, accept=accept)


def _sensing(rng: np.random.Generator, decoy: str) -> Sensing:
    bits = int(rng.integers(14, 18))
    step = 2 * np.pi / 2**bits
    return Sensing(
        rate=float(rng.choice([100, 200, 200, 500])),
        bits=bits,
        noise=min(step * float(10 ** rng.uniform(-1.0, 0.5)), 3e-4),
        colour=float(rng.uniform(0.6, 0.9)) if decoy == "coloured_noise" else 0.0,
        jitter=float(rng.choice([0.0, 0.0, 0.02, 0.05])),
        clock="loop" if rng.random() < 0.4 else "stamps",
        drops=float(rng.choice([0.0, 0.0, 0.005, 0.02])),
        missing="nan" if rng.random() < 0.5 else "rows",
        qvel=str(rng.choice(["none", "noisy", "noisy", "filtered"])),  # type: ignore[arg-type]
        qvel_noise=float(10 ** rng.uniform(-2.5, -1.7)),
        base=BaseSensing(
            position=float(rng.uniform(3e-4, 1e-3)),
            turn=float(rng.uniform(5e-4, 2e-3)),
            velocity=float(rng.uniform(5e-3, 2e-2)),
            rate=float(rng.uniform(2e-3, 5e-3)),
            imu=bool(rng.random() < 0.5),
        ),
    )
