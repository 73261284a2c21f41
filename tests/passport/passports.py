"""Estimates of a two-joint arm over units and sessions, made up: no recording, known truth."""

from __future__ import annotations

import numpy as np

from wt.data.labels import Labels
from wt.passport.estimates import GroupEstimate, Quantity
from wt.passport.folder import Addition, Source
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.types import Location

ELBOW = Quantity("joint.friction_coulomb", "joint", "elbow", "coulomb", "N·m")
DRIVE = Quantity("actuator.gain", "actuator", "a1", "factor", "-")
ZERO = Quantity("sensor.offset", "joint", "wrist", "offset", "rad")
ERROR = {ELBOW: 0.01, DRIVE: 0.005, ZERO: 2e-3}
DAYS = (1, 4, 7, 10, 22)
UNITS = ("A17", "B04", "C21")


def truth(quantity: Quantity, unit: str, session: int) -> float:
    """The elbow of A17 rubs more since its last session; drives are units' own; wrists are fine."""
    if quantity == ELBOW:
        return 0.34 if unit == "A17" and session == len(DAYS) - 1 else 0.21
    if quantity == DRIVE:
        return {"A17": 0.9, "B04": 1.0, "C21": 1.06}[unit]
    return 0.0


def estimates(sessions: range = range(len(DAYS)), seed: int = 0) -> tuple[GroupEstimate, ...]:
    """An estimate of each quantity in each of these sessions of every unit."""
    rng = np.random.default_rng(seed)
    drawn = {
        (quantity, unit, i): truth(quantity, unit, i) + ERROR[quantity] * rng.normal()
        for quantity in (ELBOW, DRIVE, ZERO)
        for unit in UNITS
        for i in range(len(DAYS))
    }
    return tuple(
        GroupEstimate(
            Labels(unit, f"2026-11-{DAYS[i]:02d}"),
            quantity,
            value,
            ERROR[quantity],
            1.0 if quantity == DRIVE else 0.0,
        )
        for (quantity, unit, i), value in drawn.items()
        if i in sessions
    )


def addition(rows: tuple[GroupEstimate, ...]) -> Addition:
    """As it is appended."""
    groups = sorted({r.labels for r in rows})
    return Addition(
        model="arm.xml",
        model_sha256="0" * 64,
        made="2026-11-25T10:00:00+00:00",
        sources=tuple(
            Source(f"/logs/{k.unit}-{k.session}.parquet", f"{k.unit}{k.session}", k) for k in groups
        ),
        hypothesis=(
            Planted(
                effects()["joint.friction_coulomb"], Location("joint", "elbow"), np.array([0.2])
            ),
        ),
        rows=rows,
        decided={"levels": []},
        notes=("The recordings of B04 contradict a stop.",),
    )
