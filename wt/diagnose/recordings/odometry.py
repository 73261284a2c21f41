"""The pose of a floating base that nothing recorded: from an IMU, and the feet that stand.

A robot knows of its trunk what an IMU measures, and how its joints move. Whatever stands still on
the ground says how fast the trunk moves (M. Bloesch et al., State estimation for legged robots,
RSS 2012): each point of the machine that may touch the ground would, if it stood, give the trunk's
velocity. Which of them stand is not known. So the velocity is the one most of them agree on, sample
after sample, that the accelerometer can follow; those that disagree count less and less.

Where the trunk was when the recording began, and its heading, nothing says: it starts above the
origin, heading along x. The ground is a plane through the feet that stood.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from wt.errors import RecordingError
from wt.physics import base, ground
from wt.physics.reach import points_near, reaching
from wt.physics.scene import Scene

_REACH = 0.05
"""Points of the machine so close [m] to being the lowest one may be standing."""
_AGREE, _ROUNDS = 0.05, 12
"""Velocity [m/s] by which a point that differs counts half, and rounds in which it is found."""
_LIFT = 0.005
"""Height over the lowest point [m] at which one counts half: the lowest are believed first."""
_SIGMA_V, _SIGMA_A, _SIGMA_BLIND = 0.02, 0.5, 10.0
"""Deviation of a standing point's velocity [m/s], of an accelerometer's reading, with what the
tilt is off by, and of the trunk's acceleration if there is none [m/s²]."""
_JOLT = 3.0
"""Accelerations that are off by so many deviations count half."""
_SIGMA_CLIMB, _SIGMA_GROUND = 0.02, 0.003
"""Deviation of the vertical velocity [m/s], and of a standing point from the plane [m]."""
UNSURE_Q, UNSURE_V = (0.0, 0.0, 1e-3, 0.0, 2e-3, 2e-3), (0.03, 0.03, 0.03, 0.01, 0.01, 0.01)
"""What a base's coordinates are off by, as :func:`wt.physics.base.names` has them [m, rad], and its
velocities [m/s, rad/s]. Where it is on a plane, and its heading, change no force.
"""
_STEADY_S = 1.0
"""Time over which gravity is averaged to say which way is up [s]."""
_PASSES = 2
"""Times that which way is up and how fast the trunk moves are estimated from one another."""
_WEIGHED, _DEEPEST = 100, 0.02
"""Samples at which what the floor carries is weighed, and the deepest that feet sink in [m]."""
_LEVEL = 0.012
"""A plane that falls by less [rad] is taken to be level."""


@dataclass(frozen=True, eq=False)
class _Imu:
    """Measurements of an IMU, in the frame of the body that floats.

    Attributes:
        turning: angular velocity [rad/s].
        force: specific force at the body's origin [m/s²]; None without an accelerometer.
        turned: orientation in the world; None if it was not recorded.
    """

    turning: Float[np.ndarray, "sample 3"]
    force: Float[np.ndarray, "sample 3"] | None
    turned: Rotation | None


@dataclass(frozen=True, eq=False)
class _Feet:
    """Points that may be standing at each sample; NaN where there are fewer than columns.

    Attributes:
        speed: the velocity of the base, were the point standing [m/s].
        low: height of the point over the lowest one [m].
        place: from the base's origin, along the world's axes [m].
        ground: height of the model's floor [m].
    """

    speed: Float[np.ndarray, "sample point 3"]
    low: Float[np.ndarray, "sample point"]
    place: Float[np.ndarray, "sample point 3"]
    ground: float


def located(
    scene: Scene,
    joint: str,
    t: Float[np.ndarray, " sample"],
    columns: Mapping[str, Float[np.ndarray, " sample"]],
) -> dict[str, Float[np.ndarray, " sample"]]:
    """The pose and velocity of a free joint that was not recorded.

    Args:
        scene: the machine.
        joint: the free joint.
        t: time [s].
        columns: of the recording.

    Returns:
        ``qpos/<joint>/0…6`` and ``qvel/<joint>/0…5``; nothing if all of its pose is recorded.

    Raises:
        RecordingError: neither its pose nor what it could be computed from was recorded.
    """
    if all(f"qpos/{joint}/{k}" in columns for k in range(7)):
        return {}
    imu = _imu(scene, joint, t, columns)
    q, v = (_table(t, columns, [f"{kind}/{n}" for n in scene.joints]) for kind in ("qpos", "qvel"))
    rates = np.gradient(q, t, axis=0)
    v = np.where(np.isfinite(v).all(axis=0), v, rates)
    turned, speed = imu.turned, np.zeros((len(t), 3))
    for _ in range(1 if turned is not None else _PASSES):  # which way is up, and how fast it moves
        now = turned if turned is not None else _upright(t, imu, speed)
        feet = _feet(scene, joint, now, imu.turning, q, v)
        speed, weight = _agreed(t, feet, _pull(imu, now))
    place = _on_the_ground(t, feet, speed, weight)
    command = [f"ctrl/{scene.model.actuator(i).name}" for i in range(scene.model.nactuator)]
    place[:, 2] -= _sunk(
        scene, joint, (place, now), (speed, imu.turning), (q, v), _table(t, columns, command)
    )
    # feet that lift or land bend the vertical speed, and where it leads; the height knows better
    speed[:, 2] = np.gradient(place[:, 2], t)
    quaternion = now.as_quat(scalar_first=True)
    pose = np.concatenate([place, quaternion], axis=1).T
    rate = np.concatenate([speed, imu.turning], axis=1).T
    return {f"qpos/{joint}/{k}": x for k, x in enumerate(pose)} | {
        f"qvel/{joint}/{k}": x for k, x in enumerate(rate)
    }


def _imu(
    scene: Scene,
    joint: str,
    t: Float[np.ndarray, " sample"],
    columns: Mapping[str, Float[np.ndarray, " sample"]],
) -> _Imu:
    """The IMU on the body of a free joint, however it is mounted there."""
    m = scene.given
    body = int(m.joint(joint).bodyid[0])
    readings: dict[str, Float[np.ndarray, "sample axis"]] = {}
    mount, arm = Rotation.identity(), np.zeros(3)
    kinds = {"GYRO": "gyro", "ACCELEROMETER": "accelerometer", "FRAMEQUAT": "orientation"}
    for i in range(m.nsensor):
        kind = mujoco.mjtSensor(int(m.sensor_type[i])).name.removeprefix("mjSENS_")
        size = int(m.sensor_dim[i])
        names = [f"sensor/{m.sensor(i).name}/{k}" for k in range(size)]
        site = int(m.sensor_objid[i])
        on_site = m.sensor_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE)
        if kind not in kinds or not on_site or m.body_weldid[m.site_bodyid[site]] != body:
            continue
        if all(n in columns and np.isfinite(columns[n]).sum() > 1 for n in names):
            readings[kinds[kind]] = _table(t, columns, names)
            mount = Rotation.from_quat(m.site_quat[site], scalar_first=True)
            arm = np.array(m.site_pos[site])
    if "gyro" not in readings or len(readings) < 2:
        raise RecordingError(
            f"where the base '{joint}' was is neither recorded nor can be computed: give "
            f"qpos/{joint}/0…6, or a gyro and an accelerometer or an orientation (framequat) of a "
            "site on its body"
        )
    turning = mount.apply(readings["gyro"])
    force, turned = None, None
    if "accelerometer" in readings:
        faster = np.gradient(turning, t, axis=0)
        lever = np.cross(faster, arm) + np.cross(turning, np.cross(turning, arm))
        force = mount.apply(readings["accelerometer"]) - lever
    if "orientation" in readings:
        turned = Rotation.from_quat(readings["orientation"], scalar_first=True) * mount.inv()
    return _Imu(turning, force, turned)


def _table(
    t: Float[np.ndarray, " sample"],
    columns: Mapping[str, Float[np.ndarray, " sample"]],
    names: list[str],
) -> Float[np.ndarray, "sample column"]:
    """Columns side by side, missing samples interpolated; NaN for one that is not there."""
    table = np.full((len(t), len(names)), np.nan)
    for k, name in enumerate(names):
        x = columns.get(name)
        if x is not None and (known := np.isfinite(x)).sum() > 1:
            table[:, k] = np.interp(t, t[known], x[known])
    return table


def _upright(
    t: Float[np.ndarray, " sample"], imu: _Imu, speed: Float[np.ndarray, "sample 3"]
) -> Rotation:
    """Orientation from the gyro, kept upright by what gravity is on average.

    Args:
        t: time [s].
        imu: with an accelerometer.
        speed: of the base in the world [m/s].
    """
    assert imu.force is not None
    steps = 0.5 * (imu.turning[1:] + imu.turning[:-1]) * np.diff(t)[:, None]
    now, turns = Rotation.identity(), [Rotation.identity()]
    for step in Rotation.from_rotvec(steps):
        now = now * step
        turns.append(now)
    drifting = Rotation.concatenate(turns)
    steady = _STEADY_S / float(np.median(np.diff(t)))
    accelerating = np.gradient(speed, t, axis=0)
    up = gaussian_filter1d(drifting.apply(imu.force), steady, axis=0)
    # where the drifting frame's axes are, the world's acceleration is known only on average
    up -= gaussian_filter1d(accelerating, steady, axis=0)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(size[:, 0], up[:, 2])
    level = Rotation.from_rotvec(axis / np.maximum(size, 1e-12) * angle[:, None])
    turned = level * drifting
    heading = Rotation.from_euler("z", -turned[0].as_euler("ZYX")[0])
    return heading * turned


def _pull(imu: _Imu, turned: Rotation) -> Float[np.ndarray, "sample 3"] | None:
    """Acceleration of the base in the world [m/s²]."""
    if imu.force is None:
        return None
    felt = turned.apply(imu.force)
    # a sensor's scale and tilt are off by a little all the time, the mean of a walk is none
    return np.asarray(felt - felt.mean(axis=0))


def _feet(
    scene: Scene,
    joint: str,
    turned: Rotation,
    turning: Float[np.ndarray, "sample 3"],
    q: Float[np.ndarray, "sample dof"],
    v: Float[np.ndarray, "sample dof"],
) -> _Feet:
    """The points that may be standing at each sample, and what each says of the base's speed."""
    m = scene.model
    planes = ground.planes(m)
    if not planes:
        raise RecordingError(
            "where the base was can be computed on a floor only: the model has no plane"
        )
    level = float(m.geom_pos[planes[0], 2])
    high = 2.0 * float(m.stat.extent)
    m = reaching(m, 2.0 * high, planes[0])
    d, jacobian = mujoco.MjData(m), np.zeros((3, m.nv))
    dofs = [scene.dof(name) for name in base.names(joint)]
    above = np.tile([0.0, 0.0, level + high], (len(q), 1))
    q, v = _with_base(scene, joint, (above, turned), (np.zeros_like(above), turning), (q, v))
    standing = []
    for pose, rate in zip(q, v, strict=True):
        d.qpos[:] = pose
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_collision(m, d)
        points, bodies, distance = points_near(m, d, planes[0])
        above = distance - distance.min(initial=np.inf)
        rows = []
        for c in np.flatnonzero(above < _REACH):
            mujoco.mj_jac(m, d, jacobian, None, points[c], bodies[c])
            rows.append((*(-jacobian @ rate), above[c], *(points[c] - pose[dofs[:3]])))
        standing.append(np.array(rows).reshape(-1, 7))
    most = max((len(rows) for rows in standing), default=0)
    table = np.full((len(standing), max(most, 1), 7), np.nan)
    for row, points in zip(table, standing, strict=True):
        row[: len(points)] = points
    return _Feet(table[..., :3], table[..., 3], table[..., 4:], level)


def _with_base(
    scene: Scene,
    joint: str,
    pose: tuple[Float[np.ndarray, "sample 3"], Rotation],
    rate: tuple[Float[np.ndarray, "sample 3"], Float[np.ndarray, "sample 3"]],
    state: tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "sample dof"]],
) -> tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "sample dof"]]:
    """Positions and velocities of all joints, with a base's place and orientation, and rates."""
    dofs = [scene.dof(name) for name in base.names(joint)]
    angles = np.unwrap(pose[1].as_euler("ZYX"), axis=0)
    q, v = state[0].copy(), state[1].copy()
    q[:, dofs] = np.column_stack([pose[0], angles])
    v[:, dofs] = np.column_stack([rate[0], base.rates(angles, rate[1])])
    return q, v


def _sunk(
    scene: Scene,
    joint: str,
    pose: tuple[Float[np.ndarray, "sample 3"], Rotation],
    rate: tuple[Float[np.ndarray, "sample 3"], Float[np.ndarray, "sample 3"]],
    state: tuple[Float[np.ndarray, "sample dof"], Float[np.ndarray, "sample dof"]],
    command: Float[np.ndarray, "sample actuator"],
) -> float:
    """How far feet sink into the floor until it carries the machine on average [m].

    MuJoCo's contacts are soft: feet that only touch carry nothing, and a replay would begin with a
    fall.
    """
    m, up = scene.model, scene.dof(base.names(joint)[2])
    d, rows = mujoco.MjData(m), np.linspace(0, len(command) - 1, _WEIGHED).astype(int)
    q, v = (x[rows] for x in _with_base(scene, joint, pose, rate, state))
    weight = float(m.body_mass.sum() * np.linalg.norm(m.opt.gravity))

    def carried(depth: float) -> float:
        force = 0.0
        for i, (pose_, rate_) in enumerate(zip(q, v, strict=True)):
            d.qpos[:], d.qvel[:], d.ctrl[:] = pose_, rate_, command[rows[i]]
            d.qpos[up] -= depth
            mujoco.mj_forward(m, d)
            force += float(d.qfrc_constraint[up]) / len(rows)
        return force - weight

    if carried(0.0) >= 0.0 or carried(_DEEPEST) <= 0.0:
        return 0.0
    return float(brentq(carried, 0.0, _DEEPEST, xtol=1e-5))


def _agreed(
    t: Float[np.ndarray, " sample"], feet: _Feet, pull: Float[np.ndarray, "sample 3"] | None
) -> tuple[Float[np.ndarray, "sample 3"], Float[np.ndarray, "sample point"]]:
    """The base's velocity [m/s], and how much each point counts, 1 if it stands."""
    known, dt = np.isfinite(feet.low), np.diff(t)
    seen = np.nan_to_num(feet.speed)
    trusted = known / (1.0 + (np.nan_to_num(feet.low) / _LIFT) ** 2)
    jump = np.zeros((len(dt), 3)) if pull is None else 0.5 * (pull[1:] + pull[:-1]) * dt[:, None]
    sigma = (_SIGMA_BLIND if pull is None else _SIGMA_A) * np.sqrt(dt * float(np.median(dt)))
    weight, believed = trusted, np.ones(len(dt))
    for _ in range(_ROUNDS):
        strong = weight / _SIGMA_V**2
        pulled = np.einsum("kp,kpi->ki", strong, seen)
        speed = _chained(strong.sum(axis=1), pulled, believed / sigma**2, jump)
        apart = np.linalg.norm(seen - speed[:, None], axis=2) / _AGREE
        weight = known * np.sqrt(trusted) / (1.0 + apart**2) ** 2
        # what jolts an accelerometer between two samples is over before the next
        apart = np.linalg.norm(np.diff(speed, axis=0) - jump, axis=1) / (_JOLT * sigma)
        believed = 1.0 / (1.0 + apart**2)
    return speed, weight


def _chained(
    weight: Float[np.ndarray, " sample"],
    pulled: Float[np.ndarray, "sample axis"],
    stiff: Float[np.ndarray, " gap"],
    jump: Float[np.ndarray, "gap axis"],
) -> Float[np.ndarray, "sample axis"]:
    """Minimise Σ wₖ(xₖ − yₖ)² + Σ sₖ(xₖ₊₁ − xₖ − jₖ)², with ``pulled`` = w·y."""
    right = pulled.copy()
    right[1:] += stiff[:, None] * jump
    right[:-1] -= stiff[:, None] * jump
    banded = np.zeros((2, len(weight)))
    banded[1] = weight + 1e-6
    banded[1, 1:] += stiff
    banded[1, :-1] += stiff
    banded[0, 1:] = -stiff
    return np.asarray(solveh_banded(banded, right))


def _on_the_ground(
    t: Float[np.ndarray, " sample"],
    feet: _Feet,
    speed: Float[np.ndarray, "sample 3"],
    weight: Float[np.ndarray, "sample point"],
) -> Float[np.ndarray, "sample 3"]:
    """Place of the base [m], its feet standing on one plane."""
    dt = np.diff(t)[:, None]
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (speed[1:] + speed[:-1]) * dt, 0)])
    place = np.nan_to_num(feet.place)
    points = moved[:, None] + place
    a, b = _slope(place, weight)
    # the plane is the floor below the start; what integration drifts by is taken off
    wanted = feet.ground + a * points[..., 0] + b * points[..., 1] - place[..., 2]
    strong = weight / _SIGMA_GROUND**2
    stiff = 1.0 / (_SIGMA_CLIMB * dt[:, 0]) ** 2
    climbed = np.diff(moved[:, 2])[:, None]
    height = _chained(strong.sum(axis=1), (strong * wanted).sum(axis=1)[:, None], stiff, climbed)
    return np.concatenate([moved[:, :2], height], axis=1)


def _slope(
    place: Float[np.ndarray, "sample point 3"], weight: Float[np.ndarray, "sample point"]
) -> tuple[float, float]:
    """Rise of the ground along x and y, as the feet that stand at the same time see it.

    Not from where the base went: a speed that is a little off leads down any slope in time.
    """
    total = np.maximum(weight.sum(axis=1), 1e-12)
    middle = np.einsum("kp,kpi->ki", weight, place) / total[:, None]
    apart = (place - middle[:, None]) * np.sqrt(weight)[:, :, None]
    x, y, z = apart.reshape(-1, 3).T
    (a, b), *_ = np.linalg.lstsq(np.column_stack([x, y]), z)
    return (0.0, 0.0) if np.hypot(a, b) < _LEVEL else (float(a), float(b))
