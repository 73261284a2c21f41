"""A Rerun recording of a policy at work: forward, sideways, turning, standing, as commanded.

Entities, on the timeline ``time`` [s]: ``world/<robot>/<body>`` (poses, geoms below),
``world/ground`` (blocks of the terrain), ``command/<axis>/commanded`` and ``…/reached``.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Float32

from wt.locomotion.config import PolicyConfig
from wt.locomotion.env import make_herd
from wt.locomotion.evaluate import Act
from wt.show import colors
from wt.show.files import write_whole
from wt.show.robot_view import body_poses, log_robot, send_columns
from wt.worlds.gait import GaitClock
from wt.worlds.legged import COMMAND, Herd, Start

_SECONDS = 3.0  # of each command
_PROGRAM = np.array(
    [(1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (-1, 0, 0), (1, 0, 1), (0, 0, 0)]
)
"""Commands one after the other, in units of the largest command."""


def record(config: PolicyConfig, act: Act, path: Path, seed: int = 0) -> None:
    """Write a recording of one robot that goes through a program of commands.

    Args:
        config: says robot, physics, scene and commands.
        act: the policy.
        path: of the ``.rrd``; an earlier file stays until this one is whole.
        seed: of the start.
    """
    herd = make_herd(config, 1, threads=1)
    command = (_PROGRAM * config.commands.largest).astype(np.float32)
    qpos, commanded, reached = _walk(herd, act, config.clock(1), command, seed)
    t = np.arange(len(qpos)) * herd.dt
    recording = rr.RecordingStream("World Translation", send_properties=False)
    memory = recording.memory_recording()
    recording.send_blueprint(_blueprint(herd))
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    time = rr.TimeColumn("time", duration=t)
    _log_ground(recording, herd.model)
    motion = body_poses(herd.model, qpos)
    log_robot(recording, _without_ground(herd.model), time, herd.robot.name, motion, colors.R)
    for i, axis in enumerate(COMMAND):
        for name, values, color in (
            ("commanded", commanded[:, i], colors.S), ("reached", reached[:, i], colors.R),
        ):  # fmt: skip
            where = ["command", axis, name]
            style = rr.SeriesLines(colors=[color], names=[name])
            recording.log(rr.new_entity_path(where), style, static=True, strict=True)
            send_columns(recording, where, time, rr.Scalars.columns(scalars=values))
    write_whole(path, memory.drain_as_bytes())


def _walk(
    herd: Herd,
    act: Act,
    clock: GaitClock,
    program: Float32[np.ndarray, "stage command=3"],
    seed: int,
) -> tuple[
    Float[np.ndarray, "step qpos"],
    Float[np.ndarray, "step command=3"],
    Float[np.ndarray, "step command=3"],
]:
    herd.reset(np.arange(1), np.random.default_rng(seed), Start())
    hold = round(_SECONDS / herd.dt)
    commanded = np.repeat(program, hold, axis=0)
    qpos = np.empty((len(commanded), herd.model.nq))
    reached = np.empty((len(commanded), 3))
    for k, command in enumerate(commanded):
        commands = command[None]
        herd.step(act(herd.observe(), commands, clock.read(herd.time, commands)))
        qpos[k], reached[k] = herd.qpos[0], herd.velocity()[0, :3]
    return qpos, commanded, reached


def _without_ground(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with the world's own geoms hidden: thousands of blocks are drawn at once."""
    model.geom_group[model.geom_bodyid == 0] = 5
    return model


def _log_ground(recording: rr.RecordingStream, model: mujoco.MjModel) -> None:
    boxes = (model.geom_bodyid == 0) & (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    if boxes.any():
        rgba = (255 * model.geom_rgba[boxes]).astype(np.uint8)
        field = rr.Boxes3D(
            half_sizes=model.geom_size[boxes], centers=model.geom_pos[boxes], colors=rgba,
            fill_mode=rr.components.FillMode.Solid,
        )  # fmt: skip
        recording.log("world/ground", field, static=True, strict=True)


def _blueprint(herd: Herd) -> rrb.Blueprint:
    body = f"world/{herd.robot.name}/{herd.robot.trunk}"
    scene = rrb.Spatial3DView(
        origin="world", name=herd.robot.name,
        eye_controls=rrb.EyeControls3D(
            position=np.array([2.0, -2.0, 1.2]) * (1 + herd.robot.height),
            look_target=np.array([0.0, 0.0, herd.robot.height / 2]),
            eye_up=[0.0, 0.0, 1.0], tracking_entity=body,
        ),
    )  # fmt: skip
    plots = [rrb.TimeSeriesView(origin=f"command/{axis}", name=axis) for axis in COMMAND]
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
    )
