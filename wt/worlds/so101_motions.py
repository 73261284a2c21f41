"""The SO-101's motions: their splits, reading them, and drawing variations of them.

Motions are split whole, and a repeat of a motion is on the motion's own side. Fast, slow over a
wide range, and steps: each side has all three. The repeats of the PRBS motion matter for
training: the same commands were answered about 70 ms later than in the first run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from wt.data.importers.sage_so101 import SageSO101
from wt.errors import ConfigError, DataError
from wt.types import Recording

TRAIN = (
    "multisine", "prbs_excitation", "repeats/prbs_excitation", "friction_gravity",
    "repeats/friction_gravity", "workspace_sweep", "repeats/workspace_sweep",
    "backlash_detection", "single_joint_elbow",
)  # fmt: skip
VALIDATION = ("fast_transitions", "repeats/fast_transitions", "velocity_ramp", "static_holding")
TEST = ("chirp_sweep", "hold_under_gravity", "step_response")

_TEMPO = 1.25  # variations run at most this much faster or slower
_SHIFT = 0.1  # rad, their largest shift of each joint


class Motions:
    """The motion folders under one folder, by split; read once, when first needed."""

    def __init__(self, folder: str | Path, splits: Mapping[str, Sequence[str]]) -> None:
        """Check that no motion is on two sides.

        Args:
            folder: what holds the motion folders.
            splits: split → names relative to ``folder``; ``repeats/x`` is a repeat of ``x``.

        Raises:
            ConfigError: an empty split, or a motion (or its repeat) on two sides.
        """
        side: dict[str, str] = {}
        for split, names in splits.items():
            if not names:
                raise ConfigError(f"world.{split} is empty; name at least one motion")
            for motion in (Path(name).name for name in names):
                if side.setdefault(motion, split) != split:
                    raise ConfigError(
                        f"world: motion '{motion}' is in both {side[motion]} and {split}; "
                        "a motion and its repeats must be on one side"
                    )
        self._folder = Path(folder)
        self._splits = {split: tuple(names) for split, names in splits.items()}
        self._read: dict[str, list[Recording]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Pickle the recordings too: their folder may not be where they are unpickled."""
        for split in self._splits:
            self.of(split)
        return self.__dict__

    def of(self, split: str) -> list[Recording]:
        """The recordings of a split, in its order.

        Raises:
            DataError: the folder or a motion in it is missing or broken.
        """
        if split not in self._read:
            names = self._splits[split]
            if not self._folder.is_dir():
                raise DataError(
                    f"world.recordings '{self._folder}' does not exist; set it to the folder that "
                    f"holds the motions ({', '.join(names)})"
                )
            importer = SageSO101()
            for name in names:
                if not importer.recognises(self._folder / name):
                    raise DataError(
                        f"world.{split}: '{self._folder / name}' is not {importer.about}; "
                        "correct the name or the folder"
                    )
            self._read[split] = [importer.read(self._folder / name, {}) for name in names]
        return self._read[split]


def vary(
    motions: Sequence[Float[np.ndarray, "_ joint"]],
    count: int,
    length: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "{count} {length} joint"]:
    """Random pieces of command sequences at another tempo and with a shift.

    Args:
        motions: command sequences of any length [rad], at the control rate.
        count: number of pieces.
        length: samples of each piece.
        rng: decides which piece, its phase, its tempo and its shift.

    Returns:
        Commands [rad]; a motion shorter than a piece holds its last command.
    """
    sizes = np.array([len(motion) for motion in motions], dtype=float)
    joints = motions[0].shape[1]
    pieces = np.empty((count, length, joints))
    for i, which in enumerate(rng.choice(len(motions), count, p=sizes / sizes.sum())):
        motion = motions[which]
        tempo = np.exp(rng.uniform(-np.log(_TEMPO), np.log(_TEMPO)))
        first = rng.uniform(0.0, max(0.0, len(motion) - 1.0 - tempo * length))
        when = first + tempo * np.arange(length)
        for j in range(joints):
            pieces[i, :, j] = np.interp(when, np.arange(len(motion)), motion[:, j])
    return pieces + rng.uniform(-_SHIFT, _SHIFT, (count, 1, joints))
