"""A rival: parameters that somebody else chose, fitted with ``mujoco.sysid``.

It gets what our diagnosis gets: the same smoothed initial states, commands averaged over the same
fine physics steps, the same stretches of the same recordings, the same patches of the MJCF. Its
results are proved by the same code. Where its defaults would spoil its result or its time it gets
better ones, and comments say so. The caller says *which* parameters are free;
:func:`every_parameter` is what an engineer frees who does not know.
"""

from __future__ import annotations

import functools
import importlib
import io
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from wt.diagnose.pipeline import STEP_S
from wt.diagnose.recordings.prepare import GIVEN, Source, unsplit
from wt.diagnose.recordings.smooth import smooth
from wt.diagnose.recordings.stretches import forgets, stretches_of
from wt.diagnose.result import Proof
from wt.diagnose.selection.holdout import prepare_holdout
from wt.diagnose.selection.proof import prove
from wt.errors import WorkError
from wt.mjcf.edit import patched_xml
from wt.physics.effect import effects
from wt.physics.planted import Planted
from wt.physics.quiet import quiet
from wt.physics.replay import Stretch
from wt.physics.scene import Scene
from wt.prove.sysid_ranges import Free, Freed, all_freed, planted

Theirs = Any  # of sysid's, which is imported late and has no types

EVERY = ("joint.armature", "joint.friction_viscous", "joint.friction_coulomb", "actuator.gain")
"""Effects that :func:`every_parameter` frees everywhere."""
TUNED = {
    # finite differences, in shares of a parameter's range, far above the constraint solver's noise
    "eps": 1e-4,
    "xtol": 1e-3,  # relative step at which it may stop
    # by which it damps a step more that made things worse; its own 1.26 may take 140 replays
    "mu_factor": 10.0,
}
"""Options with which sysid comes to the same end in less time, mostly in much less."""
_STRAY = 0.3
"""Largest distance of other starts from the first, in shares of a parameter's range."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """The outcome of a fit with sysid.

    Attributes:
        hypothesis: the effects with their parameters, ready for replays; what adds to something
            of the model's own may be negative.
        seconds: duration of the optimisation, without smoothing [s].
        xml: the model with the parameters written into it.
        squares: sum of squared open-loop errors of each joint over the fitted samples.
        count: fitted samples of each joint.
        jacobian: of all errors in the parameters, one row a sample and joint.
    """

    hypothesis: tuple[Planted, ...]
    seconds: float
    xml: str
    squares: Float[np.ndarray, " dof"]
    count: Int[np.ndarray, " dof"]
    jacobian: Float[np.ndarray, "error parameter"]

    @property
    def theta(self) -> dict[Free, Float[np.ndarray, " _theta"]]:
        """Parameters of each effect, as in the table of effects."""
        return {(p.effect.id, p.at.name): p.theta for p in self.hypothesis}

    @property
    def bic(self) -> float:
        """Schwarz' criterion (1978), each joint with a variance of its own; less is better.

        Neighbouring errors count as independent, as for whoever computes it from the residual.
        """
        n, squares = self.count[self.count > 0], self.squares[self.count > 0]
        return float(n @ np.log(squares / n) + self.jacobian.shape[1] * np.log(n.sum()))


def every_parameter(scene: Scene) -> tuple[Free, ...]:
    """Armature, damping and dry friction of every joint, and the gain of every drive."""
    known = effects()
    return tuple((name, at.name) for name in EVERY for at in known[name].places(scene))


class Rival:
    """Recordings of a machine, its :attr:`scene`, ready to be fitted as often as one likes."""

    def __init__(
        self, model: str | Path, recordings: Sequence[Source], threads: int | None = None
    ) -> None:
        """Read, check and smooth.

        Args:
            model: an MJCF file.
            recordings: Parquet files of the recording format, or recordings; all are fitted.
            threads: of its replays; as many as there are cores if left out.

        Raises:
            ModelError: the MJCF cannot be used.
            RecordingError: a recording cannot be used.
            WorkError: a package that ``mujoco.sysid`` needs is missing.
        """
        self._sysid, self._threads = _sysid(), threads or os.cpu_count() or 1
        self.scene = Scene(model)
        smoothed = smooth(self.scene, unsplit(self.scene, recordings))
        self._motion = smoothed.motion
        self._spec = self.scene.spec()
        self._spec.option.timestep = min(STEP_S, float(self.scene.model.opt.timestep))
        # sysid wants a column for every sensor, and positions are what is compared
        for sensor in list(self._spec.sensors):
            self._spec.delete(sensor)
        for name in self.scene.joints:
            self._spec.add_sensor(
                name=f"{name}_position", type=mujoco.mjtSensor.mjSENS_JOINTPOS,
                objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name,
            )  # fmt: skip
        self._forgets = forgets(smoothed, STEP_S)
        pairs = stretches_of(smoothed, self._forgets)
        self._count = np.sum([np.isfinite(q[1:]).sum(axis=0) for _, q in pairs], axis=0)
        self._sequences = self._measured(pairs)

    def fit(
        self,
        parameters: Sequence[Free],
        seed: int = 0,
        starts: int = 1,
        seconds: float = np.inf,
        options: Mapping[str, float] = TUNED,
    ) -> Fitted:
        """Fit parameters.

        Args:
            parameters: what is free; nothing is the model as it is.
            seed: of other starts than the first, which is the model as it is.
            starts: how many; the best end is returned, and all count in the time it took.
            seconds: after which it stops with the step that it is at [s].
            options: of its optimiser; empty for its own.

        Raises:
            ConfigError: a parameter cannot be fitted here, or is named twice.
        """
        freed = all_freed(self._motion, parameters)
        knobs = self._knobs(freed)
        residual = self._sysid.build_residual_fn(
            models_sequences=self._sequences,
            build_model=self._builder(freed),
            modify_residual=self._residual,
            n_threads=self._threads,
            resample_true=False,  # commands have the grid of the physics steps already
        )
        first, rng = knobs.as_vector(), np.random.default_rng(seed)
        ends, took = [], 0.0
        for start in range(starts):
            if start:
                if took >= seconds:
                    break
                drawn = first + _STRAY * rng.uniform(-1.0, 1.0, len(first))
                knobs.update_from_vector(np.clip(drawn, 0.01, 0.99))
            began = time.perf_counter()
            x, jacobian = self._optimum(knobs, residual, options, began + seconds - took)
            took += time.perf_counter() - began
            errors = np.concatenate(residual(x, knobs.copy())[0])
            ends.append((float(errors @ errors), x, jacobian, errors))
        _, x, jacobian, errors = min(ends, key=lambda end: end[0])
        hypothesis = planted(freed, x)
        return Fitted(
            hypothesis=hypothesis,
            seconds=took,
            xml=patched_xml(self.scene, hypothesis, [f"mujoco.sysid: {p}" for p in hypothesis]),
            squares=(errors.reshape(-1, self.scene.model.nv) ** 2).sum(axis=0),
            count=self._count,
            jacobian=jacobian / np.concatenate([np.zeros(0), *(f.upper - f.lower for f in freed)]),
        )

    @quiet()  # bad parameters explode
    def _optimum(
        self, knobs: Theirs, residual: Theirs, options: Mapping[str, float], until: float
    ) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, "error parameter"]]:
        """Parameters at sysid's end or at a time, as shares of ranges, and its last Jacobian."""

        def watch(steps: Sequence[Theirs]) -> None:
            if steps[-1].step is not None and time.perf_counter() > until:
                raise TimeoutError(steps[-1])

        if not knobs.size:
            return np.zeros(0), np.zeros((0, 0))
        silent = {"verbose": False, "output": io.StringIO(), "iter_callback": watch}
        try:
            _, optimum = self._sysid.optimize(knobs, residual, **silent, **options)
        except TimeoutError as late:
            last = late.args[0]
            return np.ravel(last.candidate + last.step), last.jacobian
        return optimum.x, optimum.jac

    def prove(self, fitted: Fitted, holdout: Sequence[Source], seed: int = 0) -> Proof:
        """Proof of a fit on other recordings, by the code that proves a diagnosis.

        Args:
            fitted: the fit.
            holdout: recordings that it has not seen.
            seed: of the intervals' bootstrap.

        Raises:
            RecordingError: a recording cannot be used.
        """
        smoothed = smooth(self.scene, unsplit(self.scene, holdout))
        holdout_motion = prepare_holdout(smoothed, self._forgets)
        return prove(holdout_motion, fitted.hypothesis, STEP_S, GIVEN, seed)

    def _measured(
        self, pairs: Sequence[tuple[Stretch, Float[np.ndarray, "_sample joint"]]]
    ) -> list[Theirs]:
        """The stretches in sysid's words."""
        sysid, model = self._sysid, self._spec.compile()
        h, sequences = float(model.opt.timestep), []
        for i, (stretch, q) in enumerate(pairs):
            t = stretch.t - stretch.t[0]
            steps = int(np.ceil(t[-1] / h - 1e-6))
            # sysid does not simulate the last command
            grid = h * np.arange(steps + 1)
            sequences.append(
                sysid.ModelSequences(
                    name=self.scene.path.stem,
                    spec=self._spec,
                    sequence_name=f"stretch {i}",
                    initial_state=sysid.create_initial_state(model, stretch.q0, stretch.v0),
                    control=sysid.TimeSeries(grid, stretch.commands(h, steps + 1)),
                    sensordata=sysid.TimeSeries.from_names(t, q, model),
                )
            )
        return sequences

    def _knobs(self, freed: Sequence[Freed]) -> Theirs:
        """The parameters in sysid's words, each component as a share of its range."""
        knobs = self._sysid.ParameterDict()
        for part in freed:
            low, high = np.zeros_like(part.share), np.ones_like(part.share)
            knobs.add(
                self._sysid.Parameter(f"{part.effect.id} at {part.at}", part.share, low, high)
            )
        return knobs.move_off_bounds()

    def _builder(self, freed: Sequence[Freed]) -> Callable[..., mujoco.MjModel]:
        """Compiles a model; the same one for all stretches, which sysid would compile anew."""

        @functools.lru_cache(maxsize=sum(part.effect.n_theta for part in freed) + 2)
        def compiled(shares: bytes) -> mujoco.MjModel:
            spec = self._spec.copy()
            for part in planted(freed, np.frombuffer(shares)):
                part.effect.patch(spec, part.at, part.theta)
            return spec.compile()

        return lambda knobs, spec: compiled(knobs.as_vector().tobytes())

    def _residual(
        self,
        knobs: object,
        predicted: object,
        measured: Theirs,
        model: mujoco.MjModel,
        *_: object,
        state: Float[np.ndarray, "time state"],
    ) -> tuple[Float[np.ndarray, "sample joint"], Theirs, Theirs]:
        """Errors in radians, by which results are proved; 0 where a sample is missing.

        sysid's own are shares of each signal's size in each stretch, so that a joint that rests
        near zero would outweigh all others. Positions are the state's: those of MuJoCo's sensors
        are a step late.
        """
        times, q = measured.times, state[:, 1 : 1 + model.nq]
        replayed = np.stack([np.interp(times, state[:, 0], column) for column in q.T], axis=1)
        error = np.where(np.isfinite(measured.data), replayed - measured.data, 0.0)
        error[0] = 0.0  # where the replay starts, which sysid does not report
        return error, self._sysid.TimeSeries(times, replayed, measured.signal_mapping), measured


def _sysid() -> Theirs:
    """``mujoco.sysid``, which imports as an empty module where a package that it needs is missing.

    Raises:
        WorkError: a package is missing.
    """
    sysid = importlib.import_module("mujoco.sysid")
    if not hasattr(sysid, "TimeSeries"):
        raise WorkError(
            "mujoco.sysid lacks absl-py, colorama or tabulate; "
            "install them: pip install '.[rivals]'"
        )
    return sysid
