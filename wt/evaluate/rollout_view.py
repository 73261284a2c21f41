"""A Rerun recording of a rollout: the arms side by side, predictions and errors beside them.

Entities of the recording, all on the timeline ``time`` [s]:

====================================  =========================================================
``world/<arm>/<body>``                pose of a body; each of its geoms lies below it, static
``world/<arm>/label``                 the arm's name above it
``world/<last arm>/force``            the hidden force, drawn where it acts
``prediction/<channel>/real``         a state channel as it was
``prediction/<channel>/<method>``     and as each method predicted it
``error/<channel>/<method>``          predicted − real
====================================  =========================================================

Nothing is shown and nothing is sent: the bytes are made in memory and written as one file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Real

from wt.errors import DataError
from wt.show import colors
from wt.show.files import write_whole
from wt.show.robot_view import BodyPoses, body_poses, log_robot, send_columns
from wt.types import Channel

ARM_COLORS = (colors.S, colors.TRANSLATED, colors.R)
Given = Real[np.ndarray, " ..."]
"""An array whose shape :func:`write_rollout` checks itself, with a message."""

FORCE_COLOR: colors.Color = (213, 94, 0)

_SPACING = 1.0  # of the reach, between neighbouring arms
_ARROW = 0.35  # of the reach: the largest force


def write_rollout(
    path: Path,
    model: mujoco.MjModel,
    *,
    t: Given,
    qpos: Mapping[str, Given],
    predicted: Mapping[str, Given],
    real: Given,
    channels: tuple[Channel, ...],
    force: Given | None = None,
    force_body: str | None = None,
) -> None:
    """Write a ``.rrd`` that the Rerun viewer plays; an earlier file stays until this one is whole.

    Args:
        path: the file to write.
        model: the robot; every arm is drawn with its geoms.
        t: time stamps, (T,) [s].
        qpos: generalised positions of each arm by its label, (T, nq) each; the arms stand along
            y in this order. By convention S, translated, R.
        predicted: next states predicted by each method, (T, C) each, in the channels' units.
        real: next states as they were, (T, C).
        channels: names and units of the C state channels.
        force: hidden force in world coordinates, (T, 3) [N]; None for nothing to draw.
        force_body: body at whose centre of mass the force acts on the last arm.

    Raises:
        DataError: an array's shape does not fit, or the force's body is not in the model.
        OSError: the file cannot be written.
    """
    _check(model, t, qpos, predicted, real, channels, force, force_body)
    motions = {arm: body_poses(model, positions) for arm, positions in qpos.items()}
    reach = max(*(motion.reach for motion in motions.values()), 0.1 * model.stat.extent)
    recording = rr.RecordingStream("World Translation", send_properties=False)
    memory = recording.memory_recording()
    recording.send_blueprint(_blueprint(motions, reach, channels))
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    time = rr.TimeColumn("time", duration=t)
    for place, (arm, motion) in enumerate(motions.items()):
        # seen from the front (+x), y grows to the right: the first arm stands leftmost
        y = _SPACING * reach * (place - (len(motions) - 1) / 2)
        at = rr.Transform3D(translation=[0.0, y, 0.0])
        recording.log(rr.new_entity_path(["world", arm]), at, static=True, strict=True)
        log_robot(recording, model, time, arm, motion, ARM_COLORS[place % len(ARM_COLORS)])
    if force is not None and force_body is not None:
        origins = motions[arm].com[:, _body_id(model, force_body)]
        _log_force(recording, time, arm, origins, force, reach)
    _log_series(recording, time, predicted, real, channels)
    write_whole(path, memory.drain_as_bytes())


def _check(
    model: mujoco.MjModel,
    t: Given,
    qpos: Mapping[str, Given],
    predicted: Mapping[str, Given],
    real: Given,
    channels: tuple[Channel, ...],
    force: Given | None,
    force_body: str | None,
) -> None:
    if not qpos:
        raise DataError("rollout: no arm was given; 'qpos' needs at least one")
    expected: list[tuple[str, Given, tuple[int, ...]]] = [
        (f"qpos of {arm!r}", array, (len(t), model.nq)) for arm, array in qpos.items()
    ]
    named = {"real": real, **{f"prediction of {name!r}": p for name, p in predicted.items()}}
    expected += [(name, array, (len(t), len(channels))) for name, array in named.items()]
    if force is not None:
        expected.append(("force", force, (len(t), 3)))
    for name, array, shape in expected:
        if array.shape != shape:
            raise DataError(f"rollout: {name} has shape {array.shape}, {shape} is needed")
    if force_body is not None and _body_id(model, force_body) < 0:
        raise DataError(f"rollout: the model has no body {force_body!r} for the force to act on")


def _body_id(model: mujoco.MjModel, name: str) -> int:
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name))


def _log_force(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    arm: str,
    origins: Float[np.ndarray, "time xyz=3"],
    force: Float[np.ndarray, "time xyz=3"],
    reach: float,
) -> None:
    """The force as an arrow from ``origins`` [m]; no arrow while it is zero or unknown."""
    size = np.linalg.norm(force, axis=1)
    acts = size > 0
    scale = _ARROW * reach / size[acts].max(initial=1e-9)  # m/N
    arrows = rr.Arrows3D.columns(
        vectors=scale * force[acts],
        origins=origins[acts],
        labels=[f"{newton:.0f} N" for newton in size[acts]],
    )
    path = ["world", arm, "force"]
    style = rr.Arrows3D.from_fields(colors=[FORCE_COLOR], radii=[0.015 * reach], show_labels=True)
    recording.log(rr.new_entity_path(path), style, static=True, strict=True)
    send_columns(recording, path, time, arrows.partition(acts.astype(int)))


def _log_series(
    recording: rr.RecordingStream,
    time: rr.TimeColumn,
    predicted: Mapping[str, Float[np.ndarray, "time channel"]],
    real: Float[np.ndarray, "time channel"],
    channels: tuple[Channel, ...],
) -> None:
    for c, channel in enumerate(channels):
        parts = channel.name.split("/")
        truth = ["prediction", *parts, "real"]
        _send_series(recording, truth, time, real[:, c], colors.R, width=3.0)
        for method, prediction in predicted.items():
            path, color = [*parts, method], colors.of_method(method)
            _send_series(recording, ["prediction", *path], time, prediction[:, c], color)
            error = prediction[:, c] - real[:, c]
            _send_series(recording, ["error", *path], time, error, color)


def _send_series(
    recording: rr.RecordingStream,
    path: list[str],
    time: rr.TimeColumn,
    values: Float[np.ndarray, " time"],
    color: colors.Color,
    width: float = 1.5,
) -> None:
    style = rr.SeriesLines(colors=[color], widths=[width], names=[path[-1]])
    recording.log(rr.new_entity_path(path), style, static=True, strict=True)
    send_columns(recording, path, time, rr.Scalars.columns(scalars=values))


def _blueprint(
    motions: Mapping[str, BodyPoses], reach: float, channels: tuple[Channel, ...]
) -> rrb.Blueprint:
    """The 3D scene on the left; on the right one tab a joint, values and errors below each other.

    Channels of one joint (``qpos/joint1``, ``qvel/joint1``) share its tab.
    """
    tabs: dict[str, list[Channel]] = {}
    for channel in channels:
        tabs.setdefault(channel.name.partition("/")[2] or channel.name, []).append(channel)
    heights = np.concatenate([motion.pos[:, 1:, 2].ravel() for motion in motions.values()])
    center = np.array([0.0, 0.0, (heights.min() + heights.max()) / 2])
    distance = reach * (1.0 + 0.75 * len(motions))
    scene = rrb.Spatial3DView(
        origin="world",
        name="arms",
        eye_controls=rrb.EyeControls3D(
            position=center + distance * np.array([0.9, 0.0, 0.4]),
            look_target=center,
            eye_up=[0.0, 0.0, 1.0],
        ),
    )
    plots = [
        rrb.Vertical(
            *(
                rrb.TimeSeriesView(
                    origin=rr.new_entity_path([group, *channel.name.split("/")]),
                    name=f"{channel.name} {group} [{channel.unit}]",
                    # the colours mean the same in every plot: one legend covers less
                    plot_legend=rrb.PlotLegend(
                        rrb.Corner2D.RightTop,
                        visible=group == "prediction" and channel is group_channels[0],
                    ),
                )
                for channel in group_channels
                for group in ("prediction", "error")
            ),
            name=tab,
        )
        for tab, group_channels in tabs.items()
    ]
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Tabs(*plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
    )
