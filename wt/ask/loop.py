"""The closed loop: diagnose, design, run, and diagnose again, until nothing is open."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wt.ask import SOURCE
from wt.ask.alive import Alive, alive
from wt.ask.design import Design, Designer
from wt.ask.limits import limits_of
from wt.ask.robot import Robot
from wt.ask.separation import Separation
from wt.diagnose.effort import effort_of
from wt.diagnose.experiment.excite import excite
from wt.diagnose.experiment.reach import Shown, reach_of
from wt.diagnose.experiment.release import passive
from wt.diagnose.pace import Pace, Say
from wt.diagnose.pipeline import Outcome, audited, searched, told
from wt.diagnose.result import Diagnosis
from wt.diagnose.selection.decisions import DecisionLog
from wt.errors import ModelError
from wt.physics.quiet import quiet
from wt.physics.scene import Scene
from wt.types import Recording

RATE_HZ = 200.0
"""Of commands where no recording has a rate."""


@dataclass(frozen=True, eq=False)
class Wish:
    """What is asked for.

    Attributes:
        seconds: length of an experiment.
        most: experiments at most.
        precision: half a 95 % interval over its value that every parameter of a finding is to
            have; None if names alone are asked for.
        whole_range: whether the model's joint ranges are free of obstacles, so that joints may go
            anywhere in them; else only a little beyond what was recorded.
        seed: of everything random.
    """

    seconds: float = 20.0
    most: int = 3
    precision: float | None = None
    whole_range: bool = False
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Round:
    """What some recordings leave open, and the experiment that is run for it.

    Attributes:
        claimed: effects that are claimed, in words.
        rivals: what these recordings cannot tell from one of them, in words.
        design: the experiment; None if none is run.
        reason: why none is, in one clause; "" if one is.
    """

    claimed: tuple[str, ...]
    rivals: tuple[str, ...]
    design: Design | None
    reason: str

    def to_json(self) -> dict[str, Any]:
        """As in ``asked.json``."""
        said: dict[str, Any] = {"claimed": list(self.claimed), "rivals": list(self.rivals)}
        if self.design is not None:
            said["experiment"] = {
                "motions": list(self.design.motions),
                "expected_nats": self.design.expected.apart.tolist(),
                "expected_information_nats": self.design.expected.information,
            }
        return said


@dataclass(frozen=True, eq=False)
class Answer:
    """What asking came to.

    Attributes:
        diagnosis: of all recordings.
        rounds: what each left open, in order.
    """

    diagnosis: Diagnosis
    rounds: tuple[Round, ...]

    def to_json(self) -> dict[str, Any]:
        """The content of ``asked.json``: ``open`` tells whether rivals are left."""
        last = self.rounds[-1]
        rounds = [r.to_json() for r in self.rounds]
        return {"schema": 1, "rounds": rounds, "open": bool(last.rivals), "stopped": last.reason}


class Experiments:
    """Experiments that were run, in order."""

    def __init__(
        self,
        robot: Robot,
        keep: Callable[[str, Recording], None],
        aside: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        """Take over what the robot has carried out before.

        Args:
            robot: carries experiments out.
            keep: called with (name, recording) of commands before they are sent, and of what was
                measured.
            aside: entered while an experiment runs, when a person may have to read and press keys.
        """
        self._robot, self._keep, self._aside = robot, keep, aside
        self.recorded: list[Recording] = []
        while (earlier := robot.performed(len(self.recorded) + 1)) is not None:
            self.recorded.append(earlier)

    def run(self, commands: Recording) -> None:
        """Carry out one more."""
        number = len(self.recorded) + 1
        self._keep(f"experiment_{number}", commands)
        with self._aside():
            measured = self._robot.perform(number, commands)
        if not self._robot.keeps:
            self._keep(f"recorded_{number}", measured)
        self.recorded.append(measured)


@quiet()
def ask(
    model: Path,
    given: Sequence[Recording],
    experiments: Experiments,
    wish: Wish,
    *,
    follow: Callable[[Round], None] = lambda _: None,
    progress: Say | None = None,
) -> Answer:
    """Diagnose, and have experiments run for what stays open.

    Args:
        model: the MJCF as given.
        given: recordings so far; without any the first experiment is a mild motion of all joints.
        experiments: has them run.
        wish: what is asked for.
        follow: called with each round, before its experiment is run.
        progress: called as the work goes on.

    Raises:
        ModelError: the MJCF cannot be used, or is of a machine that cannot be asked.
        RecordingError: a recording cannot be used.
        WorkError: an experiment was not carried out.
    """
    began, scene = time.monotonic(), Scene(model)
    refuse(scene)
    if not given and not experiments.recorded:
        reach = reach_of(scene, (), wish.whole_range)
        experiments.run(excite(scene, reach, (), wish.seconds, RATE_HZ, SOURCE, wish.seed))
    rounds: list[Round] = []
    while not rounds or rounds[-1].design:
        fit, held_out = _split(given, experiments.recorded)
        pace = Pace(progress, None)
        scene, prepared = audited(model, fit, held_out, pace)
        outcome = searched(scene, prepared, wish.seed, DecisionLog(), pace)
        rounds.append(_round(scene, outcome, len(experiments.recorded), wish))
        follow(rounds[-1])
        if rounds[-1].design:
            experiments.run(rounds[-1].design.commands)
    diagnosis = replace(told(scene, outcome), seconds=time.monotonic() - began)
    return Answer(diagnosis, tuple(rounds))


def refuse(scene: Scene) -> None:
    """Refuse machines that no open-loop command can safely move.

    Raises:
        ModelError: it is one.
    """
    if passive(scene):
        raise ModelError(
            "nothing drives this machine, so it cannot be asked; wt diagnose says how to release it"
        )
    if scene.free:
        raise ModelError(
            "its base is free, and commands that are sent without looking would let it fall; hold "
            "the base and take its free joint out of the model, or record by its own controller "
            "and use wt diagnose"
        )


def _split(
    given: Sequence[Recording], experiments: Sequence[Recording]
) -> tuple[list[Recording], list[Recording]]:
    """What is fitted, and what only the proof sees.

    Experiments are fitted: what tells hypotheses apart is in them alone. What was recorded before
    proves what is found.
    """
    recorded = [*given, *experiments]
    if len(recorded) == 1:
        return recorded, []
    proof = max(0, len(given) - 1)
    return recorded[:proof] + recorded[proof + 1 :], [recorded[proof]]


def _round(scene: Scene, outcome: Outcome, run: int, wish: Wish) -> Round:
    """What is open, and the experiment for it; ``run`` of them were run before."""
    claimed = tuple(p.statement(scene) for p in outcome.claims.estimated.hypothesis)
    if not claimed:
        return Round((), (), None, "nothing that has a name is missing")
    left = alive(outcome)
    rivals = _names(left, larger=False)
    blunt = wish.precision is not None and _blunt(outcome, wish.precision)
    settled = None
    if not rivals and not blunt:
        precise = "" if wish.precision is None else ", and all is as precise as asked"
        settled = Round(claimed, (), None, f"no other name fits{precise}")
    if settled and len(left) == 1:
        return settled
    if run >= wish.most:
        reason = "as many experiments were run as were asked for"
        return settled or Round(claimed, rivals, None, reason)
    design = _designer(scene, outcome, left, wish.whole_range).design(
        wish.seconds, wish.seed + run, blunt
    )
    if design is None:  # a larger law that no motion would show is no other name
        return settled or Round(claimed, rivals, None, "no safe motion would tell more")
    return Round(claimed, (*rivals, *_names(left, larger=True)), design, "")


def _names(left: Sequence[Alive], larger: bool) -> tuple[str, ...]:
    """What differs in hypotheses, in words: in larger laws, or in rivals."""
    return tuple(str(a.differs) for a in left if a.differs is not None and a.larger == larger)


def _blunt(outcome: Outcome, precision: float) -> bool:
    """Whether some parameter of what is claimed is known less precisely than asked."""
    for named in outcome.claims.estimated.estimates:
        for estimate in named.values():
            value, (low, high) = np.atleast_1d(estimate.value), map(np.atleast_1d, estimate.ci95)
            if ((high - low) / 2.0 > precision * np.linalg.norm(value)).any():
                return True
    return False


def _designer(scene: Scene, outcome: Outcome, left: Sequence[Alive], whole_range: bool) -> Designer:
    """Designs by what the recordings showed of the machine."""
    naming, prepared = outcome.naming, outcome.prepared
    sets = (False, outcome.fitted), (True, naming.holdout.smoothed)
    shown = [
        Shown(prepared.names[samples.recording], held_out, samples.q, v, q)
        for held_out, smoothed in sets
        for samples, (q, v, _) in zip(smoothed.samples, smoothed.at_samples, strict=True)
    ]
    acted = [samples.activation for _, smoothed in sets for samples in smoothed.samples]
    limits = limits_of(scene, shown, acted, whole_range)
    measured = np.isfinite(outcome.fitted.noise)
    noise = np.where(measured, naming.objective.floor, np.nan)
    separation = Separation(scene, left, noise, effort_of(scene).search_step)
    rate = float(np.median([r.rate_hz for r in prepared.used]))
    return Designer(scene, reach_of(scene, shown, whole_range), rate, separation, left, limits)
