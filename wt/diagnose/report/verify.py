"""Proof by the files: what is written is replayed in plain MuJoCo by a process of its own.

That process (:mod:`wt.mjcf.plain`) has only the written folder, whose ``holdout.npz`` says where
each window of the held-out recordings begins; nothing of the search reaches it. So anybody gets the
same figures, and ``wt verify`` does.

``holdout.npz`` holds, for N samples of W windows: ``joints``, ``actuators``, ``added`` (names; the
last are joints of the patch), ``recordings`` (names) and ``recording`` (W), ``first`` (first sample
of each window), ``q0``, ``v0`` (W, joint: the smoothed measurements at that sample), ``added_q``,
``added_v`` (W, added), ``activation`` (W, actuator: what drives of the given model that have
dynamics act on there, else NaN), ``remembered`` (names), ``remembered_x`` (W, remembered: states
that come of all that was before, see :class:`wt.physics.hooks.Remembering`), ``lead_first`` (W),
``lead_t``, ``lead`` (times and commands of the samples before each window), ``t`` (N) [s since the
recording's start], ``command`` (N, actuator), ``measured`` (N, joint; NaN where missing) and
``noise`` (joint: of the measurements).
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

import wt.mjcf.plain
from wt.diagnose.selection.holdout import RAN_AWAY, Holdout
from wt.errors import UserError, WorkError
from wt.physics.activation import dynamic
from wt.physics.job import begun, initial_states
from wt.physics.planted import Hypothesis
from wt.physics.replay import Stretch
from wt.show.files import write_together

HOLDOUT = "holdout.npz"
MODEL, PHYSICS = "model.xml", "physics.py"

Errors = Float[np.ndarray, "sample joint"]


@dataclass(frozen=True, eq=False)
class Replayed:
    """Errors of what the files replay, (N, joint); NaN where nothing was measured.

    Attributes:
        model: of ``model.xml`` alone.
        physics: with ``physics.py``; the same where there is none.
        before: of the model that was given; empty if it was not replayed.
    """

    model: Errors
    physics: Errors
    before: Float[np.ndarray, "given joint"]


def holdout_npz(holdout: Holdout, hypothesis: Hypothesis, recordings: Sequence[str]) -> bytes:
    """The content of ``holdout.npz``.

    Args:
        holdout: what is replayed.
        hypothesis: what was found; joints that it adds begin where they had got to.
        recordings: names of the recordings, by index.
    """
    scene, stretches = holdout.smoothed.motion.scene, holdout.stretches
    here = holdout.here(hypothesis)
    states = [initial_states(scene, here, s) for s in stretches]
    added = [name for name in states[0] if name not in scene.joints]
    hidden = np.array([[state[name] for name in added] for state in states]).reshape(
        len(stretches), len(added), 2
    )
    remembered = [{k: x for p in here for k, x in p.remembered(s).items()} for s in stretches]
    model = scene.model
    with io.BytesIO() as stream:
        np.savez_compressed(
            stream,
            joints=np.array(scene.joints, dtype=str),
            actuators=np.array([model.actuator(i).name for i in range(model.nactuator)], dtype=str),
            added=np.array(added, dtype=str),
            recordings=np.array(recordings, dtype=str),
            recording=np.array([s.recording for s in stretches]),
            first=_first(stretches, "t"),
            q0=np.stack([s.q0 for s in stretches]),
            v0=np.stack([s.v0 for s in stretches]),
            added_q=hidden[..., 0],
            added_v=hidden[..., 1],
            t=np.concatenate([s.t for s in stretches]),
            command=np.concatenate([s.command for s in stretches]),
            activation=np.stack(
                [np.where(dynamic(model), begun(model, s), np.nan) for s in stretches]
            ),
            remembered=np.array(list(remembered[0]), dtype=str),
            remembered_x=np.array([list(state.values()) for state in remembered]),
            lead_first=_first(stretches, "lead_t"),
            lead_t=np.concatenate([s.lead_t for s in stretches]),
            lead=np.concatenate([s.lead for s in stretches]),
            measured=holdout.measured,
            noise=np.nan_to_num(holdout.smoothed.noise),
        )
        return stream.getvalue()


def _first(stretches: Sequence[Stretch], times: str) -> Int[np.ndarray, " stretch"]:
    """Where the samples of each stretch begin, of all one after another."""
    return np.cumsum([0, *(len(getattr(s, times)) for s in stretches[:-1])])


_LIBRARIES = sorted({str(Path(m.__file__).parents[1]) for m in (mujoco, np) if m.__file__})
"""Folders of numpy and mujoco, wherever this process has them from."""
_START = (
    "import json, runpy, sys; sys.path += json.loads(sys.argv[1]); "
    "del sys.argv[:2]; runpy.run_path(sys.argv[0], run_name='__main__')"
)
"""An isolated interpreter knows no PYTHONPATH, by which the libraries may have been found here."""


def replayed(folder: Path, before: Path | None = None) -> Replayed:
    """Replay a written folder in a process that has nothing else.

    Args:
        folder: with ``model.xml``, ``holdout.npz`` and possibly ``physics.py``.
        before: the model that was given, to be replayed alike.

    Raises:
        WorkError: the files do not run.
    """
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "replayed.npz"
        arguments = [wt.mjcf.plain.__file__, str(folder.resolve()), str(out)]
        arguments += [str(before.resolve())] if before else []
        program = [sys.executable, "-IB", "-c", _START, json.dumps(_LIBRARIES), *arguments]
        try:
            # in scratch, MuJoCo writes its log of replays that explode
            done = subprocess.run(
                program, cwd=scratch, env=_alone(), capture_output=True, text=True
            )
        except PermissionError:
            # a blind trial's guard lets no process start: the same code, in this one
            wt.mjcf.plain.main(arguments[1:])
        else:
            if done.returncode:
                last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
                raise WorkError(f"the files of '{folder}' do not run in plain MuJoCo: {last}")
        with np.load(out, allow_pickle=False) as replays, np.load(folder / HOLDOUT) as stored:
            errors = {name: _error(replays[name], stored["measured"]) for name in replays.files}
    model = errors["model"]
    return Replayed(model, errors.get("physics", model), errors.get("before", model[:0]))


def _alone() -> dict[str, str]:
    """The environment without a way to code of ours, and without telemetry."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return kept | {"ORT_DISABLE_TELEMETRY": "1", "OMP_NUM_THREADS": "1"}


def _error(q: Errors, measured: Errors) -> Errors:
    return np.asarray(np.where(np.isfinite(q), q, measured + RAN_AWAY) - measured)


def replayed_files(contents: Mapping[str, str | bytes], given_xml: str) -> Replayed:
    """Replay files that are not written yet, and the model that was given.

    Args:
        contents: by name, see :func:`replayed`.
        given_xml: the MJCF as given.
    """
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "diagnosis"
        folder.mkdir()
        write_together(folder, contents)
        before = Path(scratch) / "given.xml"
        before.write_text(given_xml, encoding="utf-8")
        return replayed(folder, before)


@dataclass(frozen=True)
class Verified:
    """What a folder's files leave of the held-out error, and what its ``diagnosis.json`` says.

    Attributes:
        unit: of the errors.
        before: error of the model that was given, as stated.
        model: error that ``model.xml`` alone leaves.
        physics: … and with ``physics.py``.
        stated_model, stated_physics: as in ``diagnosis.json``.
        has_physics: whether there is a ``physics.py``.
        windows: number of replays.
        seconds: of recordings that they cover.
    """

    unit: str
    before: float
    model: float
    physics: float
    stated_model: float
    stated_physics: float
    has_physics: bool
    windows: int
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether the figures are those of ``diagnosis.json``, but for other machines' rounding."""
        pairs = ((self.model, self.stated_model), (self.physics, self.stated_physics))
        return all(abs(a - b) <= _ROUNDING * max(a, b, 1e-12) for a, b in pairs)


_ROUNDING = 0.01


def verify(folder: Path) -> Verified:
    """Replay a written diagnosis and compare with what it says.

    Raises:
        UserError: it is no folder of a diagnosis.
        WorkError: its files do not run.
    """
    missing = [n for n in ("diagnosis.json", MODEL, HOLDOUT) if not (folder / n).is_file()]
    if missing:
        raise UserError(
            f"'{folder}' has no {missing[0]}; give the folder that wt diagnose --out wrote"
        )
    try:
        said = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
        fit = said["fit"]["holdout"]
        stated = (fit["before_rmse"], fit["model_only"]["after_rmse"], fit["after_rmse"])
        before, stated_model, stated_physics = map(float, stated)
        with np.load(folder / HOLDOUT, allow_pickle=False) as stored:
            t, first = stored["t"], stored["first"]
            ends = [*(first[1:] - 1), len(t) - 1]
            seconds = float(sum(t[ends] - t[first]))
    except (ValueError, KeyError, TypeError, OSError, zipfile.BadZipFile) as error:
        raise UserError(f"'{folder}' cannot be read as a diagnosis: {error}") from error
    errors = replayed(folder)
    return Verified(
        unit=str(fit["unit"]),
        before=before,
        model=_rmse(errors.model),
        physics=_rmse(errors.physics),
        stated_model=stated_model,
        stated_physics=stated_physics,
        has_physics=(folder / PHYSICS).is_file(),
        windows=len(first),
        seconds=seconds,
    )


def _rmse(errors: Errors) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))
