"""What the name of a quantity says: ``shoulder_cmd_deg`` is a command of shoulder, in degrees."""

from __future__ import annotations

import re
from dataclasses import dataclass

_COMMAND = {
    "action", "actions", "cmd", "command", "commanded", "commands", "control", "ctrl", "des",
    "desired", "goal", "input", "ref", "reference", "setpoint", "target", "targets", "u",
}  # fmt: skip
_VELOCITY = {
    "dq", "dqpos", "omega", "qd", "qdot", "qvel", "speed", "vel", "velocities", "velocity",
}  # fmt: skip
_FORCE = {"effort", "efforts", "force", "frc", "moment", "tau", "torque", "torques", "trq"}
_POSITION = {
    "angle", "angles", "counts", "enc", "encoder", "phi", "pos", "position", "positions", "q",
    "qpos", "theta", "ticks",
}  # fmt: skip
_TIME = {"clock", "elapsed", "stamp", "t", "time", "timestamp", "timestamps"}
_SENSORS = {
    "gyro": {"gyro", "gyroscope"},
    "accelerometer": {"acc", "accel", "accelerometer", "acceleration"},
}
_OTHER = {
    "amp", "amps", "current", "currents", "ddq", "kd", "kp", "mode", "quat", "quaternion", "rpy",
    "temp", "temperature",
}  # fmt: skip
"""Quantities that a recording has no column for."""
_NOISE = {
    "actual", "actuator", "data", "dof", "est", "estimated", "feedback", "filtered", "joint",
    "joints", "jnt", "log", "low", "lowcmd", "lowstate", "meas", "measured", "motor", "motors",
    "msg", "obs", "observation", "observations", "present", "robot", "sensor", "servo", "state",
    "states", "value", "values",
}  # fmt: skip
_UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad",
    "radians": "rad", "rpm": "rpm", "rev": "rev", "mm": "mm",
}  # fmt: skip
_SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3,
            "millis": 1e-3, "us": 1e-6, "usec": 1e-6, "micros": 1e-6, "ns": 1e-9, "nsec": 1e-9,
            "nanos": 1e-9}  # fmt: skip
_TOKEN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
_LETTERS = str.maketrans({"µ": "u", "μ": "u", "θ": "theta", "ω": "omega", "τ": "tau", "φ": "phi"})


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes:
        kind: time, qpos, qvel, ctrl, force, gyro, accelerometer, other, or None where it is silent.
        stem: what is left for the joint, words joined by ``_``; "" where nothing is.
        unit: of an angle or length, as a map has it, or None.
        seconds: the unit of a time [s], or None.
        of: what a command is a command of: qpos, qvel, force, or None.
    """

    kind: str | None
    stem: str
    unit: str | None = None
    seconds: float | None = None
    of: str | None = None


def words(name: str) -> list[str]:
    """A name's words and numbers, in small letters.

    Args:
        name: of a quantity, a joint or an actuator.
    """
    return [token.lower() for token in _TOKEN.findall(name.translate(_LETTERS))]


def core(name: str) -> list[str]:
    """A name's words without those that every joint's name may have.

    Args:
        name: of a joint or an actuator.
    """
    return [word for word in words(name) if word not in _NOISE]


def meaning(name: str) -> Meaning:
    """What the name of a quantity says.

    Args:
        name: as it stands in the source.
    """
    said = words(name)
    unit = next((_UNITS[w] for w in said if w in _UNITS), None)
    seconds = next((_SECONDS[w] for w in said if w in _SECONDS), None)
    quantity = _quantity(said)
    if quantity is None and said and (said[0] in _TIME or said[-1] in _TIME):
        return Meaning("time", "", seconds=seconds)
    command = any(w in _COMMAND for w in said)
    if quantity == "other":
        return Meaning("other", "")
    kind = "ctrl" if command and quantity in (None, "qpos", "qvel", "force") else quantity
    # a word counts as the joint's unless it says something else: "current position" is no current
    spoken = _COMMAND | _VELOCITY | _FORCE | _POSITION | _NOISE | set(_UNITS) | {"current", "v"}
    if kind in _SENSORS:
        spoken = spoken | _SENSORS[kind] | {"imu"}
    left = [w for w in said if w not in spoken]
    return Meaning(kind, "_".join(left), unit, seconds, quantity if kind == "ctrl" else None)


def _quantity(said: list[str]) -> str | None:
    """What is measured or commanded, if the words tell."""
    if [word for word in said if not word.isdigit()] == ["v"]:
        return "qvel"
    tells = [("qvel", _VELOCITY), ("force", _FORCE), ("other", _OTHER), *_SENSORS.items()]
    for kind, vocabulary in tells:
        if any(word in vocabulary for word in said):
            return "qpos" if kind == "other" and _of_position(said) else kind
    return "qpos" if _of_position(said) else None


def _of_position(said: list[str]) -> bool:
    return any(word in _POSITION for word in said) and not {"kp", "kd", "ddq"} & set(said)
