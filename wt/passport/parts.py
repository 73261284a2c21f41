"""The joints, drives and sensors of a machine: a card has the state of every one of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from wt.passport.estimates import Quantity
from wt.physics.scene import Scene

Sort = Literal["joint", "actuator", "encoder", "sensor"]


@dataclass(frozen=True, order=True)
class Part:
    """A part of the machine.

    Attributes:
        sort: what it is; an encoder is called as its joint, a sensor is one of the MJCF.
        name: in the MJCF.
    """

    sort: Sort
    name: str

    def __str__(self) -> str:
        """As on cards."""
        return f"encoder of {self.name}" if self.sort == "encoder" else f"{self.sort} {self.name}"


def parts_of(scene: Scene) -> tuple[Part, ...]:
    """Every joint, drive and sensor of a model, in its order."""
    m = scene.given
    return (
        *(Part("joint", name) for name in scene.own_joints),
        *(Part("actuator", m.actuator(i).name) for i in range(m.nactuator)),
        *(Part("encoder", name) for name in scene.own_joints),
        *(Part("sensor", m.sensor(i).name) for i in range(m.nsensor)),
    )


def spotless(parts: Sequence[Part], quantities: Iterable[Quantity]) -> list[Part]:
    """Those of which no quantity is another than in the model."""
    touched = {_touched(quantity) for quantity in quantities}
    return [p for p in parts if not {(p.sort, p.name), (p.sort, "all")} & touched]


def _touched(quantity: Quantity) -> tuple[str, str]:
    encoder = quantity.effect.startswith("sensor.") and quantity.kind == "joint"
    return "encoder" if encoder else quantity.kind, quantity.place
