"""What carries an experiment out: a simulated machine, or a person at the real one."""

from __future__ import annotations

import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import mujoco
import numpy as np

from wt.ask import SOURCE
from wt.data import recording as recordings
from wt.errors import ModelError, RecordingError, WorkError
from wt.types import Recording

_POLL_S = 0.5
RECORDING = "recording.parquet"
"""Of a run of wt-run."""
_SETTLED_S = 3.0
"""A simulated machine stands so long under the first command before anything is recorded [s]."""


class Robot(ABC):
    """Carries out experiments.

    Attributes:
        keeps: whether what was measured lies where it is looked for already.
    """

    keeps: ClassVar[bool] = False

    @abstractmethod
    def perform(self, number: int, commands: Recording) -> Recording:
        """Send commands and give what was measured.

        Args:
            number: of the experiment, from 1 on.
            commands: ``ctrl/<actuator>`` to send, from the pose of the first ``qpos/<joint>``.

        Raises:
            WorkError: it could not be carried out.
        """

    def performed(self, number: int) -> Recording | None:
        """What an earlier call measured in an experiment that need not be repeated."""
        return None


class SimulatedRobot(Robot):
    """A machine in MuJoCo, of which nothing but its recordings is looked at."""

    def __init__(self, world: Path, noise: float, seed: int) -> None:
        """Load it.

        Args:
            world: MJCF of the machine; joints and actuators are called as in the model.
            noise: standard deviation of its encoders [rad or m].
            seed: of that noise.

        Raises:
            ModelError: MuJoCo cannot load it.
        """
        try:
            self._model = mujoco.MjModel.from_xml_path(str(world))
        except (ValueError, OSError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise ModelError(f"--world {world} does not load: {reason}") from error
        self._noise, self._rng = noise, np.random.default_rng(seed)

    def perform(self, number: int, commands: Recording) -> Recording:
        """Stand where the commands begin, then follow them; each is held until the next."""
        model, data = self._model, mujoco.MjData(self._model)
        columns = commands.columns
        try:
            sent = {
                name: model.actuator(name.removeprefix("ctrl/")).id
                for name in columns
                if name.startswith("ctrl/")
            }
            read = {
                name: model.joint(name.removeprefix("qpos/")).qposadr[0]
                for name in columns
                if name.startswith("qpos/")
            }
        except KeyError as error:
            raise ModelError(
                f"--world is another machine than the model: {error.args[0]}"
            ) from None
        for name, at in read.items():
            data.qpos[at] = columns[name][0]
        measured = {name: np.empty(len(commands.t)) for name in read}
        data.time = commands.t[0] - _SETTLED_S
        for k, t in enumerate(commands.t):
            for name, at in sent.items():
                data.ctrl[at] = columns[name][max(k - 1, 0)]
            while data.time < t - 0.5 * model.opt.timestep:
                mujoco.mj_step(model, data)
            for name, at in read.items():
                measured[name][k] = data.qpos[at]
        for values in measured.values():
            values += self._noise * self._rng.standard_normal(len(values))
        followed = {name: columns[name] for name in sent}
        meta = {"source": SOURCE, "rate": commands.rate_hz, "notes": f"experiment {number}"}
        return Recording(commands.t, {**followed, **measured}, meta)


class FileRobot(Robot):
    """A person, or a program, who takes commands from a file and puts a recording beside it."""

    keeps = True

    def __init__(self, folder: Path, wait: float, say: Callable[[str], None]) -> None:
        """Set up.

        Args:
            folder: where ``experiment_N.parquet`` is found and ``recorded_N.parquet`` is put.
            wait: longest time for that [s].
            say: called with a line for the person.
        """
        self._folder, self._wait, self._say = folder, wait, say

    def perform(self, number: int, commands: Recording) -> Recording:
        """Say what is to be done and wait for it.

        Raises:
            WorkError: nothing came in time; the same call finds it when it is there.
        """
        path, answer = self._folder / f"experiment_{number}.parquet", self._answer(number)
        self._say(f"run {path} on the robot and put its recording at {answer}")
        end = time.monotonic() + self._wait
        while not answer.exists():
            if time.monotonic() > end:
                raise WorkError(
                    f"no {answer} after {self._wait:g} s; when it is there, run the same command "
                    "again, which goes on from it"
                )
            time.sleep(_POLL_S)
        return self._read(answer)

    def performed(self, number: int) -> Recording | None:
        """The recording that lies there already."""
        answer = self._answer(number)
        return self._read(answer) if answer.exists() else None

    def _answer(self, number: int) -> Path:
        return self._folder / f"recorded_{number}.parquet"

    def _read(self, path: Path) -> Recording:
        end = time.monotonic() + 10 * _POLL_S
        while True:
            try:
                return recordings.read(path)
            except RecordingError:
                if time.monotonic() > end:  # it is not just being written
                    raise
                time.sleep(_POLL_S)


class Go2Robot(FileRobot):
    """A Go2 whose trunk is held in the air, on the network: ``wt-run`` plays the commands.

    Its guards and watchdogs are those of a walk, and a person decides when: keys or the remote
    bring the legs to where the commands begin, start them, and stop them at any time.
    """

    keeps = False

    def __init__(
        self, folder: Path, model: Path, interface: str, domain: int, limits: Sequence[str] = ()
    ) -> None:
        """Set up; nothing is sent yet.

        Args:
            folder: of the experiments; ``run_N`` in it is what wt-run leaves of each.
            model: MJCF with the drives' gains.
            interface: of the network.
            domain: of DDS.
            limits: ``KEY=VALUE`` changes of the limits at which wt-run stops.
        """
        super().__init__(folder, 0.0, lambda line: None)
        self._model = model
        self._line = [*limits, "--interface", interface, "--domain", str(domain)]

    def perform(self, number: int, commands: Recording) -> Recording:
        """Have them played; the recording begins where the legs began to move there.

        Raises:
            WorkError: the robot was not there, or it ended before the commands did.
        """
        run = self._folder / f"run_{number}"
        words = ["--play", str(self._folder / f"experiment_{number}.parquet"), *self._line]
        words += ["--model", str(self._model), "--out", str(run)]
        done = subprocess.run([sys.executable, "-m", "deploy.cli.run", *words], check=False)
        again = "the same command begins this experiment again"
        if done.returncode:
            raise WorkError(f"wt-run ended with {done.returncode} (above); {again}")
        if not (run / RECORDING).exists():
            raise WorkError(f"nothing was recorded in {run}; {again}")
        measured = recordings.read(run / RECORDING)
        whole = float(commands.t[-1] - commands.t[0])
        if measured.t[-1] < whole:
            raise WorkError(
                f"wt-run ended after {measured.t[-1]:.1f} s of {whole:.1f} s of commands; {again}"
            )
        meta = {"source": SOURCE, "notes": f"experiment {number}"}
        return replace(measured, meta={**measured.meta, **meta})
