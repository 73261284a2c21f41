"""ROS 2 messages of the known types as streams of recording columns.

Stamps are given from outside, nanoseconds, one a message.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Shaped

from wt.data.importers._clock import Stream, stream
from wt.errors import DataError

_Values = Shaped[np.ndarray, " _"] | Sequence[float]

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
TYPES = (JOINT_STATE, TRAJECTORY, MULTI_ARRAY, IMU, ODOMETRY)

FIELDS = ("position", "velocity", "effort")
_KINDS = {"position": "qpos", "velocity": "qvel", "effort": "force"}


def joint_states(topic: str, stamps: Sequence[int], messages: Sequence[Any]) -> Stream:
    """Measured joints. Velocities and efforts that are all exactly zero were not measured.

    Raises:
        DataError: a message has another number of values than of names.
    """
    rows = []
    for message in messages:
        row: dict[str, float] = {}
        for field, kind in _KINDS.items():
            values = getattr(message, field)
            if len(values):
                _same_length(topic, field, message.name, values)
                row |= {f"{kind}/{n}": float(x) for n, x in zip(message.name, values, strict=True)}
        rows.append(row)
    made = stream(stamps, rows)
    kept = {
        n: x for n, x in made.columns.items() if n.startswith("qpos/") or np.nan_to_num(x).any()
    }
    return Stream(made.stamps, kept)


def joint_commands(
    topic: str, stamps: Sequence[int], messages: Sequence[Any], field: str | None
) -> Stream:
    """Commands sent as JointState: positions, else velocities, else efforts, unless ``field``."""
    rows = []
    for message in messages:
        values = _chosen(topic, {f: getattr(message, f) for f in FIELDS}, field)
        _same_length(topic, "command", message.name, values)
        rows.append({f"ctrl/{n}": float(x) for n, x in zip(message.name, values, strict=True)})
    return stream(stamps, rows)


def trajectories(
    topic: str, stamps: Sequence[int], messages: Sequence[Any], field: str | None
) -> Stream:
    """Commands sent as JointTrajectory: the goal that the controller moves to.

    A point is in force from the time of the point before it, the first from the message on; a
    new message replaces what is left of the one before.
    """
    times: list[int] = []
    rows: list[dict[str, float]] = []
    order = np.argsort(np.array(stamps), kind="stable")
    for i in order:
        start, message = stamps[i], messages[i]
        while times and times[-1] >= start:
            times.pop()
            rows.pop()
        from_here = start
        for point in message.points:
            by_field = dict(
                zip(FIELDS, (point.positions, point.velocities, point.effort), strict=True)
            )
            values = _chosen(topic, by_field, field)
            _same_length(topic, "point", message.joint_names, values)
            names = zip(message.joint_names, values, strict=True)
            times.append(from_here)
            rows.append({f"ctrl/{name}": float(x) for name, x in names})
            due = point.time_from_start
            from_here = max(start + due.sec * 10**9 + due.nanosec, from_here + 1)
    return stream(times, rows)


def multi_arrays(
    topic: str, stamps: Sequence[int], messages: Sequence[Any], order: Sequence[str]
) -> Stream:
    """Commands sent as bare numbers, in the joints' ``order``.

    Raises:
        DataError: a message has another number of values than there are joints.
    """
    rows = []
    for message in messages:
        if len(message.data) != len(order):
            raise DataError(
                f"topic '{topic}' sends {len(message.data)} numbers for {len(order)} joints "
                f"({', '.join(order)}); set in the map 'order: [joint, …]' as the controller has it"
            )
        rows.append({f"ctrl/{n}": float(x) for n, x in zip(order, message.data, strict=True)})
    return stream(stamps, rows)


def imu(topic: str, stamps: Sequence[int], messages: Sequence[Any]) -> Stream:
    """An Imu as sensors <topic>_gyro, _accelerometer and, where known, _orientation (wxyz)."""
    name = topic.strip("/").replace("/", "_")
    rows = []
    for message in messages:
        w, a, q = message.angular_velocity, message.linear_acceleration, message.orientation
        groups: dict[str, tuple[float, ...]] = {
            "gyro": (w.x, w.y, w.z),
            "accelerometer": (a.x, a.y, a.z),
        }
        # ROS marks an orientation that is not known with -1
        if message.orientation_covariance[0] != -1.0:
            groups["orientation"] = (q.w, q.x, q.y, q.z)
        rows.append(
            {
                f"sensor/{name}_{g}/{i}": v
                for g, values in groups.items()
                for i, v in enumerate(values)
            }
        )
    return _continuous(stream(stamps, rows), f"sensor/{name}_orientation/", 0)


def odometry(stamps: Sequence[int], messages: Sequence[Any]) -> Stream:
    """A base as a free joint named like the message's child frame, in MuJoCo's order.

    ROS gives the linear velocity in the child's frame; MuJoCo's is in the world's.
    """
    rows = []
    for message in messages:
        joint = message.child_frame_id.replace("/", "_") or "base"
        p, o = message.pose.pose.position, message.pose.pose.orientation
        v, w = message.twist.twist.linear, message.twist.twist.angular
        quaternion, linear = np.array([o.w, o.x, o.y, o.z]), np.zeros(3)
        # v_world = R(q) · v_body
        mujoco.mju_rotVecQuat(linear, np.array([v.x, v.y, v.z]), quaternion)
        row = {f"qpos/{joint}/{i}": x for i, x in enumerate((p.x, p.y, p.z, *quaternion.tolist()))}
        row |= {f"qvel/{joint}/{i}": x for i, x in enumerate((*linear.tolist(), w.x, w.y, w.z))}
        rows.append(row)
    made = stream(stamps, rows)
    for joint in dict.fromkeys(name.split("/")[1] for name in made.columns):
        made = _continuous(made, f"qpos/{joint}/", 3)
    return made


def _continuous(made: Stream, prefix: str, first: int) -> Stream:
    """The stream with a quaternion's sign kept from sample to sample, to interpolate between."""
    names = [f"{prefix}{first + i}" for i in range(4)]
    if any(name not in made.columns for name in names):
        return made
    q = np.stack([made.columns[name] for name in names], axis=1)
    turned = np.nan_to_num((q[1:] * q[:-1]).sum(axis=1)) < 0.0
    q[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
    return Stream(made.stamps, {**made.columns, **dict(zip(names, q.T, strict=True))})


def _chosen(topic: str, by_field: dict[str, _Values], field: str | None) -> _Values:
    given = [name for name in FIELDS if len(by_field[name])]
    if not given or (field is not None and field not in given):
        raise DataError(
            f"topic '{topic}' sends a command with {', '.join(given) or 'no values'}"
            + (f"; the map's command_field is {field!r}" if field else "")
        )
    return by_field[field or given[0]]


def _same_length(topic: str, what: str, names: Sequence[str], values: _Values) -> None:
    if len(names) != len(values):
        raise DataError(
            f"topic '{topic}': a {what} has {len(values)} values for {len(names)} names; the "
            "message is broken, leave the topic out with 'topics' in the map"
        )
