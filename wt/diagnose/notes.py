"""What a reader has to know of a diagnosis besides its findings, in sentences."""

from __future__ import annotations

from wt.diagnose.selection.claims import Claims
from wt.diagnose.selection.holdout import Holdout
from wt.diagnose.unvisited import Unvisited


def notes(
    holdout: Holdout, claims: Claims, timestep: float | None, beyond: Unvisited | None
) -> tuple[str, ...]:
    """Sentences on how it was proven, on commands between samples and on time steps.

    Args:
        holdout: the held-out recordings.
        claims: what is claimed.
        timestep: a finer one than the model's own [s], if the files have one.
        beyond: a part of a joint's range that most of what is left of it is from.
    """
    scene, commands = holdout.smoothed.motion.scene, holdout.smoothed.commands
    said = [
        f"The held-out recordings hardly excite {p}: it is proven on the fitted ones, each part "
        "left out in turn."
        for p, gain in zip(claims.estimated.hypothesis, claims.gains, strict=True)
        if gain.in_turn
    ]
    if beyond:
        said.append(beyond.sentence(scene))
    if claims.events:
        said.append(
            "When the machine was pushed, and how hard, is read off each recording itself, the "
            "held-out ones too: no other recording predicts it."
        )
    if commands > 1:
        rate = 1.0 / min(s.dt for s in holdout.smoothed.samples)
        said.append(
            f"The controller seems to have sent {commands} commands for each sample of the log. "
            "What they were in between is a guess, and with it whatever is said of delays and of "
            f"damping: a log at {rate:.3g} Hz would tell."
        )
    if timestep:
        said.append(
            f"The model's time step of {1e3 * scene.model.opt.timestep:g} ms is too coarse for "
            f"these recordings: model.xml has {1e3 * timestep:g} ms, as the replays do."
        )
    if not holdout.forgets:
        every = max(s.t[-1] - s.t[0] for s in holdout.stretches)
        said.append(
            f"The machine does not forget its initial state: replays restart every {every:.2g} s."
        )
    return tuple(said)
