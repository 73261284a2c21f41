"""Layouts of arrays that robotics programs write, each with the code that writes it.

``pace``: the ``.pt`` files of PACE (github.com/leggedrobotics/pace-sim2real, its data collection):
``time`` [s], ``dof_pos``, ``des_dof_pos`` [rad], (N, joint).

``mjlab``: motions of github.com/mujocolab/mjlab, ``src/mjlab/scripts/csv_to_npz.py``: ``fps``,
``joint_pos``, ``joint_vel``; joints in the order of the MJCF, whose names it does not keep.

``aloha``: episodes of ALOHA (github.com/tonyzhaozh/act, ``record_sim_episodes.py``, and the names,
order and 50 Hz of its ``constants.py``): ``observations/qpos``, ``/qvel``, ``/effort``, ``action``.

``isaac_lab``: a demo of Isaac Lab's ``HDF5DatasetFileHandler`` (github.com/isaac-sim/IsaacLab) with
the states of ``InteractiveScene.get_state``, written *after* the step that an action went into: the
command in force from a state on is the next row's. The base's pose is left out.

``robomimic``: a demo with the observations of robosuite (robomimic.github.io/docs/datasets):
``obs/robot0_joint_pos``, ``obs/robot0_joint_vel``. Its actions are poses of the hand, no commands
of joints, and are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

_ARM = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate", "gripper")
_ISAAC = "states/articulation/robot"


@dataclass(frozen=True)
class Layout:
    """One program's arrays.

    Attributes:
        name: of the program.
        tables: array → kind of recording column; the first must be there.
        time: array of times [s], or None.
        fps: array of one rate [Hz], or None.
        rate_hz: the rate where it is always the same [Hz], or None.
        joints: names by number of columns; else those of the file, else joint0, joint1, ….
        next_row: kinds of which the value in force stands one row further down.
        assumed: what the file does not say, for the user.
    """

    name: str
    tables: Mapping[str, str]
    time: str | None = None
    fps: str | None = None
    rate_hz: float | None = None
    joints: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    next_row: frozenset[str] = frozenset()
    assumed: tuple[str, ...] = ()

    def fits(self, names: Iterable[str]) -> bool:
        """True if arrays of these names are of this layout."""
        there = set(names)
        needed = {next(iter(self.tables)), self.time, self.fps} - {None}
        return needed <= there


LAYOUTS = (
    Layout(
        "pace",
        {"dof_pos": "qpos", "des_dof_pos": "ctrl", "dof_vel": "qvel"},
        time="time",
    ),
    Layout(
        "mjlab",
        {"joint_pos": "qpos", "joint_vel": "qvel"},
        fps="fps",
        assumed=("joints are in the MJCF's order, as mjlab writes them",),
    ),
    Layout(
        "aloha",
        {
            "observations/qpos": "qpos",
            "observations/qvel": "qvel",
            "observations/effort": "force",
            "action": "ctrl",
        },
        rate_hz=50.0,
        joints={14: tuple(f"{side}_{name}" for side in ("left", "right") for name in _ARM)},
        assumed=(
            "ALOHA's files have no time: 50 Hz, as its constants have it; if it was another, set "
            "in the map 'time: {rate: …}'",
        ),
    ),
    Layout(
        "isaac_lab",
        {
            f"{_ISAAC}/joint_position": "qpos",
            f"{_ISAAC}/joint_velocity": "qvel",
            "processed_actions": "ctrl",
        },
        next_row=frozenset({"ctrl"}),
        assumed=("joints are in the order of the simulated articulation; the file has no names",),
    ),
    Layout(
        "robomimic",
        {"obs/robot0_joint_pos": "qpos", "obs/robot0_joint_vel": "qvel"},
        assumed=("robomimic's actions are left out: they are poses of the hand, as a rule",),
    ),
)


def layout_of(names: Iterable[str]) -> Layout | None:
    """The layout that arrays of these names are of."""
    there = list(names)
    return next((layout for layout in LAYOUTS if layout.fits(there)), None)
