"""Which columns are mixed up: a stepwise search among suspects.

A suspect is kept if the model explains at least one command with it that it cannot explain
without, and by a wide margin. Each step takes the suspect after which least is left; at the end
each has to be missed when it is taken back alone, and to leave in balance what no drive moves: a
cart whose pole carries an unknown load has no encoder in other units. So two faults are found where
each alone would leave the other one's error, and none where the model merely lacks physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from wt.check.audit import Subject, Suspect
from wt.check.balance import Balance, Edit
from wt.check.finding import AuditFinding
from wt.check.velocity import belongs
from wt.types import Recording

WRONG = 0.08
"""Share of a command left unexplained above which something may be mixed up."""
DECISIVE = 5.0
"""A suspect has to divide what is left of some command by so much."""
RIGHT = 0.3
"""… and to leave no more than this share of it."""
STEP = 0.7
"""Of the logarithm of what is left, summed over drives: a step that is taken."""
AMBIGUOUS = 0.7
"""Confidence where something else would explain as much."""
_ALIKE = 0.5  # … by which two suspects cannot be told apart
_FLOOR = 1e-5
_MOST = 6


@dataclass(frozen=True, eq=False)
class _State:
    suspects: tuple[Suspect, ...]
    left: Float[np.ndarray, " row"]

    @property
    def edits(self) -> tuple[Edit, ...]:
        return tuple(e for s in self.suspects for e in s.edits)

    @property
    def total(self) -> float:
        return total(self.left)


def total(left: Float[np.ndarray, " row"]) -> float:
    """What is left of all commands together: the sum of logarithms."""
    return float(np.log(left + _FLOOR).sum())


def search(balance: Balance, suspects: Sequence[Suspect]) -> list[tuple[Suspect, str, float]]:
    """The suspects without which the model cannot explain the commands.

    Returns:
        Each with the evidence for it, and a confidence.
    """
    state = _State((), balance.unexplained())
    if (state.left > WRONG).any():
        sprung = balance.unexplained(sprung=True)
        suspects = [s for s in suspects if not _looks_sprung(balance, s, sprung)]
    while len(state.suspects) < _MOST and (state.left > WRONG).any():
        trials = [_with(balance, state, s) for s in suspects if _apart(state, s)]
        best = _named(trials, min(trials, key=lambda trial: trial.total, default=state))
        if best.total > state.total - STEP:
            break
        state = best
    return _needed(balance, state, suspects)


def _named(trials: Sequence[_State], best: _State) -> _State:
    """The best, or a unit of as few columns as may be that has a name and says as much."""
    if not best.suspects or not best.suspects[-1].kind.endswith(("_scale", "_unit")):
        return best
    alike = [
        trial
        for trial in trials
        if trial.suspects[-1].kind.endswith("_unit") and trial.total < best.total + _ALIKE
    ]
    return min(alike, key=lambda trial: (len(trial.edits), trial.total), default=best)


def _with(balance: Balance, state: _State, suspect: Suspect) -> _State:
    chosen = (*state.suspects, suspect)
    edits = tuple(e for s in chosen for e in s.edits)
    return _State(chosen, balance.unexplained(edits))


def _looks_sprung(balance: Balance, suspect: Suspect, sprung: Float[np.ndarray, " row"]) -> bool:
    """Tell whether a spring in its joints explains the commands about as well as a suspect.

    Over the part of a turn that a joint goes, one may pull as the weight at another angle does, or
    in another unit.

    Args:
        balance: of the recording.
        suspect: what may be mixed up.
        sprung: what is left of each row where springs may adapt and nothing is mixed up.
    """
    own = _own(balance, suspect)
    left = balance.unexplained(suspect.edits)
    return bool((sprung < np.minimum(WRONG, DECISIVE * left))[own].all())


def _apart(state: _State, suspect: Suspect) -> bool:
    """Tell whether no channel of a suspect was edited before."""
    taken = {(e.group, e.index) for e in state.edits}
    return not any((e.group, e.index) in taken for e in suspect.edits)


def _needed(
    balance: Balance, state: _State, suspects: Sequence[Suspect]
) -> list[tuple[Suspect, str, float]]:
    """Those of a state that are missed when each alone is taken back."""
    removable: list[tuple[Suspect, str, float]] = []
    for i, suspect in enumerate(state.suspects):
        rest = replace(state, suspects=state.suspects[:i] + state.suspects[i + 1 :])
        without = balance.unexplained(rest.edits)
        ratio = without / np.maximum(state.left, 1e-9)
        proven = (
            _own(balance, suspect) & (ratio > DECISIVE) & (without > WRONG) & (state.left < RIGHT)
        )
        if not proven.any() or balance.upset(state.edits, rest.edits):
            continue
        row = int(np.argmax(np.where(proven, ratio, 0.0)))
        name = balance.rows[row].drive.name
        said = (
            f"the motion explains {_percent(1.0 - state.left[row])} of {name}'s command if "
            f"{suspect.evidence}, and {_percent(1.0 - without[row])} as recorded"
        )
        confidence = 1.0 - float(state.left[row] / without[row])
        others = _others(balance, rest, state, suspect, suspects)
        if others:
            said += f"; it cannot be told from this: {', or '.join(others)}"
            confidence = min(confidence, AMBIGUOUS)
        removable.append((suspect, said, confidence))
    return removable


def _others(
    balance: Balance,
    rest: _State,
    state: _State,
    suspect: Suspect,
    suspects: Sequence[Suspect],
) -> list[str]:
    """What would explain as much as a suspect: of each set of channels that which does most."""
    best: dict[frozenset[tuple[str, int]], tuple[float, str]] = {}
    for other in suspects:
        if other is suspect or not _apart(rest, other):
            continue
        total = _with(balance, rest, other).total
        channels = frozenset((e.group, e.index) for e in other.edits)
        if total < min(state.total + _ALIKE, best.get(channels, (np.inf, ""))[0]):
            best[channels] = total, other.evidence
    return [evidence for _, evidence in best.values()]


def _own(balance: Balance, suspect: Suspect) -> Bool[np.ndarray, " row"]:
    """Rows that have to show a suspect: those of its own channels, or all if it has none."""
    edited = {(e.group, e.index) for e in suspect.edits}
    own = [
        ("q", row.drive.dof) in edited or ("u", row.drive.index) in edited for row in balance.rows
    ]
    return np.array(own if any(own) else [True] * len(own))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share > 0.005 else "nothing"


def found(subject: Subject, suspects: Sequence[Suspect]) -> list[AuditFinding]:
    """The findings of a search on a recording."""
    balance, recording = subject.balance, subject.recording
    if balance is None or recording is None:
        return []
    return [
        AuditFinding(
            suspect.kind,
            tuple(columns_of(balance, suspect.edits, recording)),
            suspect.elements,
            said[:1].upper() + said[1:],
            _fix(suspect, balance, recording),
            confidence,
            change=Undone(balance, suspect.edits),
        )
        for suspect, said, confidence in search(balance, suspects)
    ]


def _fix(suspect: Suspect, balance: Balance, recording: Recording) -> str:
    """The entry of a map; where a suspect leaves it open, the factors of all that it changes."""
    if suspect.fix:
        return suspect.fix
    moves = [
        (target, e.factor, offset)
        for e in suspect.edits
        for target, _, offset in _moves(balance, e, recording)
    ]
    parts = {
        "units": {n: f"{abs(f):.6g}" for n, f, _ in moves if abs(f) != 1.0},
        "signs": {n: "-1" for n, f, _ in moves if f < 0.0},
        "offsets": {n: f"{o:.5g}" for n, _, o in moves if o != 0.0},
    }
    said = {
        key: ", ".join(f"{name}: {value}" for name, value in entries.items())
        for key, entries in parts.items()
    }
    return ", ".join(f"{key}: {{{entries}}}" for key, entries in said.items() if entries)


@dataclass(frozen=True, eq=False)
class Undone:
    """Edits on the columns of a recording."""

    balance: Balance
    edits: tuple[Edit, ...]

    def __call__(self, recording: Recording) -> Recording:
        """The recording as it should have been."""
        columns = dict(recording.columns)
        for e in self.edits:
            for target, source, offset in _moves(self.balance, e, recording):
                columns[target] = e.factor * recording.columns[source] + offset
        return replace(recording, columns=columns)


def _moves(balance: Balance, e: Edit, recording: Recording) -> list[tuple[str, str, float]]:
    """(target, source, offset) of the columns that an edit changes.

    A velocity goes with its position where it is the slope of it: then one encoder gave both.
    """
    if e.group == "u":
        names = [balance.scene.model.actuator(i).name for i in (e.index, e.source)]
        return [(f"ctrl/{names[0]}", f"ctrl/{names[1]}", e.offset)]
    target, source = balance.joint(e.index), balance.joint(e.source)
    moves = [(f"qpos/{target}", f"qpos/{source}", e.offset)]
    other = e.source != e.index or e.factor != 1.0
    if other and f"qvel/{target}" in recording.columns and belongs(recording, source):
        moves.append((f"qvel/{target}", f"qvel/{source}", 0.0))
    return moves


def columns_of(balance: Balance, edits: Sequence[Edit], recording: Recording) -> list[str]:
    """Columns of a recording that edits change."""
    return [target for e in edits for target, _, _ in _moves(balance, e, recording)]
