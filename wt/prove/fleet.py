"""Fleets: units of one machine over sessions, of which it is hidden what belongs to which level.

Some effects have the same size on all units (the model's), some another on each unit, some another
in each session; and from some session on one unit is no longer what it was. All units' masses and
dampings err by a few per cent besides, each unit's in its own way.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from wt.data import recording as recordings
from wt.prove.answer import Answer
from wt.prove.case import Case, HiddenEffect
from wt.prove.catalog import parameters
from wt.prove.places import places
from wt.prove.rigs import RIGS, nominal_xml
from wt.prove.sensing import Sensing
from wt.prove.world import hidden_plant, observe

UNITS, SESSIONS, SECONDS = 12, 6, 8.0
DAYS = 3
"""Between two sessions."""
_NEUTRAL = {"actuator.gain": 1.0}
_SPREAD = (0.5, 1.5)
"""Between units or sessions an effect is this much of what was drawn."""
_GROWS = 1.8
"""What changes on one unit becomes so much of what it was there."""
_MAY_BE = {
    "session": ("actuator.gain", "sensor.offset"),
    "model": ("joint.friction_coulomb", "joint.friction_viscous"),
    "unit": ("joint.friction_coulomb", "joint.friction_viscous", "sensor.offset"),
}
"""Level → effects, as real fleets have them; those with the fewest places first."""


@dataclass(frozen=True)
class Trait:
    """An effect that belongs to a level.

    Attributes:
        effect: as it was drawn, with one parameter.
        level: model, unit or session.
        sizes: value of the parameter, by unit and session.
    """

    effect: HiddenEffect
    level: str
    sizes: Float[np.ndarray, "unit session"] = field(compare=False)

    @property
    def parameter(self) -> str:
        """Its name."""
        return next(iter(self.effect.parameters))

    @property
    def quantity(self) -> str:
        """As passports call it, e.g. ``joint.friction_coulomb/elbow/coulomb``."""
        return f"{self.effect.effect}/{self.effect.name}/{self.parameter}"


@dataclass(frozen=True)
class FleetCase:
    """One trial.

    Attributes:
        name: unique in its set.
        rig: name in ``RIGS``.
        seed: of everything that is random in it.
        traits: what is hidden.
        changed: trait, unit and first session of the change.
        sensing: sensors and clock.
    """

    name: str
    rig: str
    seed: int
    traits: tuple[Trait, ...]
    changed: tuple[int, int, int]
    sensing: Sensing


def fleets(seed: int, units: int = UNITS, sessions: int = SESSIONS) -> list[FleetCase]:
    """The cases of the set ``fleet``; the same for the same seed."""
    return [
        _draw(f"{i:03d}-{rig}-fleet", rig, (units, sessions), np.random.default_rng([seed, i, 12]))
        for i, rig in enumerate(("arm2_passive", "arm3", "arm3_motor"))
    ]


def _draw(name: str, rig: str, shape: tuple[int, int], rng: np.random.Generator) -> FleetCase:
    noise = Sensing(rate=100.0, bits=16, noise=5e-5, qvel="noisy", qvel_noise=2e-3)
    traits: list[Trait] = []
    taken, there = set[int](), set[tuple[str, int]]()
    for level, effects in _MAY_BE.items():
        free = [(e, j) for e in effects for j in places(e, rig) if j not in taken]
        free = [place for place in free if place not in there]
        effect, joint = free[int(rng.integers(len(free)))]
        there.add((effect, joint))
        if len(taken) + 1 < len(RIGS[rig].links):  # two at a joint where there is no other
            taken.add(joint)
        seed = int(rng.integers(2**31))
        drawn = parameters(effect, rig, joint, "obvious", noise.position_noise, seed)
        traits.append(_trait(rig, effect, joint, level, drawn, shape, rng))
    which, unit = int(rng.integers(1, 3)), int(rng.integers(shape[0]))  # not the session's
    since = int(rng.integers(2, shape[1]))
    changing = traits[which]
    sizes = changing.sizes.copy()
    neutral = _NEUTRAL.get(changing.effect.effect, 0.0)
    sizes[unit, since:] = neutral + _GROWS * (sizes[unit, since:] - neutral)
    traits[which] = replace(changing, sizes=sizes)
    seed = int(rng.integers(2**31))
    return FleetCase(name, rig, seed, tuple(traits), (which, unit, since), noise)


def _trait(
    rig: str, effect: str, joint: int, level: str, drawn: dict[str, object],
    whole: tuple[int, int], rng: np.random.Generator,
) -> Trait:  # fmt: skip
    ((parameter, value),) = drawn.items()
    neutral, name = _NEUTRAL.get(effect, 0.0), RIGS[rig].joints[joint]
    shape = {"model": (1, 1), "unit": (whole[0], 1), "session": whole}[level]
    share = rng.uniform(*_SPREAD, shape) if level != "model" else np.ones(shape)
    if effect == "sensor.offset" and level == "session":
        share *= rng.choice([-1.0, 1.0], shape)  # set by hand, anew each time
    sizes = np.broadcast_to(neutral + share * (float(value) - neutral), whole)  # type: ignore[arg-type]
    kind, at = ("actuator", f"{name}_drive") if effect.startswith("actuator.") else ("joint", name)
    return Trait(HiddenEffect(effect, kind, at, {parameter: value}, effect), level, sizes)


def write_files(case: FleetCase, folder: Path) -> Answer:
    """Simulate a fleet and write its files; returns its answer."""
    (folder / "robot.xml").write_text(nominal_xml(RIGS[case.rig], 0.002))
    units, sessions = case.traits[0].sizes.shape
    for unit in range(units):
        seed = int(np.random.default_rng([case.seed, unit]).integers(2**31))
        for session in range(sessions):
            truth = tuple(
                replace(t.effect, parameters={t.parameter: float(t.sizes[unit, session])})
                for t in case.traits
            )
            machine = Case(
                case.name, case.rig, seed, "triple", truth, case.sensing,
                ("multisine",) * sessions, SECONDS,
            )  # fmt: skip
            recorded = observe(machine, hidden_plant(machine), session).recording
            labels = {"unit": f"U{unit:02d}", "session": f"2026-03-{1 + DAYS * session:02d}"}
            meta = {"robot": case.rig, "source": "concealed trial", **labels}
            path = folder / f"fit-{labels['unit']}-{session}.parquet"
            recordings.write(replace(recorded, meta=meta), path)
    which, unit, since = case.changed
    hidden = {
        "levels": {t.quantity: t.level for t in case.traits},
        "change": {
            "quantity": case.traits[which].quantity,
            "unit": f"U{unit:02d}",
            "session": since,
            "by": float(np.ptp(case.traits[which].sizes[unit])),
        },
        "units": units,
        "sessions": sessions,
    }
    return Answer(case.name, "fleet", (), (), rig=case.rig, fleet=hidden)
