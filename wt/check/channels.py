"""Which columns are mixed up: a stepwise search among suspects.

A suspect is kept if the model explains at least one command with it that it cannot explain
without, and by a wide margin. Each step takes the suspect after which least is left; at the end
each has to be missed when it is taken back alone, and to leave in balance what no drive moves: a
cart whose pole carries an unknown load has no encoder in other units. So two faults are found where
each alone would leave the other one's error, and none where the model merely lacks physics. A
factor that was fitted beside the other one's error is wrong: what is suspected is listed anew
behind what was found, and takes the place of a suspect of the same channels that explains less.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
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
FAINT = 0.004
"""… above which something is mixed up if two drives say so :data:`OVERWHELMING`."""
OVERWHELMING = 25.0
"""Where less than :data:`WRONG` is left of a suspect's own command, it has to divide that and what
is left of another drive's by so much: no physics is missed so exactly."""
DECISIVE = 5.0
"""A suspect has to divide what is left of some command by so much."""
RIGHT = 0.3
"""… and to leave no more than this share of it."""
STEP = 0.7
"""Of the logarithm of what is left, summed over drives: a step that is taken."""
AMBIGUOUS = 0.7
"""Confidence where something else would explain as much."""
_ALIKE = 0.5  # … by which two suspects cannot be told apart
_BEYOND = 1.0  # of the logarithm of what is left: what a joint beyond its limits counts
_STARTS = 3  # suspects that are begun with, where what seemed best leaves something
_REFITTED = 0.05  # of a factor, by which two fits of it may differ
_FLOOR = 1e-5
_MOST = 6


@dataclass(frozen=True, eq=False)
class _State:
    suspects: tuple[Suspect, ...]
    left: Float[np.ndarray, " row"]
    beyond: int

    @property
    def edits(self) -> tuple[Edit, ...]:
        return tuple(e for s in self.suspects for e in s.edits)

    @property
    def total(self) -> float:
        """What is left, and where the joints are not: of two that explain it one may be there."""
        return total(self.left) + _BEYOND * self.beyond


def total(left: Float[np.ndarray, " row"]) -> float:
    """What is left of all commands together: the sum of logarithms."""
    return float(np.log(left + _FLOOR).sum())


Listing = Callable[[Balance], Sequence[Suspect]]
"""Lists what is suspected of a recording."""


def search(balance: Balance, suspected: Listing) -> list[tuple[Suspect, str, float]]:
    """The suspects without which the model cannot explain the commands.

    Args:
        balance: of the recording.
        suspected: lists what is suspected, of it and of the same with something undone.

    Returns:
        Each with the evidence for it, and a confidence.
    """
    none, suspects = _with_all(balance, ()), suspected(balance)
    state, known = _greedy(balance, none, suspects, suspected)
    if (state.left > WRONG).any():
        # beside another fault a wrong suspect may look best, or none better than nothing
        trials = sorted((_with(balance, none, s) for s in suspects), key=lambda trial: trial.total)
        for start in [t for t in trials if t.suspects != state.suspects[:1]][:_STARTS]:
            other, more = _greedy(balance, start, _listed(balance, start, suspected), suspected)
            known += more
            if other.total < state.total - STEP and _simple(balance, other):
                state = other
    state, others = _reconsidered(balance, state, suspected)
    state = _whole(balance, _mirrored(balance, state, [*suspects, *known]))
    while True:
        needed = _needed(balance, state, [*known, *others])
        if len(needed) == len(state.suspects):
            return needed
        # what was found beside one that is none has to be needed without it
        state = _with_all(balance, tuple(suspect for suspect, _, _ in needed))


def _simple(balance: Balance, state: _State) -> bool:
    """Tell whether a state explains every command, and blames no drive for both of its columns.

    Of many pairs that are tried, one on a joint that something holds fits its noise.
    """
    edited = {(e.group, e.index) for e in state.edits}
    both = any({("q", r.drive.dof), ("u", r.drive.index)} <= edited for r in balance.rows)
    return not both and bool((state.left < WRONG).all())


def _greedy(
    balance: Balance, state: _State, suspects: Sequence[Suspect], suspected: Listing
) -> tuple[_State, list[Suspect]]:
    """A state with what explains most, one suspect after another; and all that was listed.

    Args:
        balance: of the recording.
        state: to begin with.
        suspects: beside it.
        suspected: lists what is suspected further on.
    """
    known = list(suspects)
    while len(state.suspects) < _MOST and (state.left > FAINT).any():
        trials = [_with(balance, state, s) for s in suspects if _apart(state, s)]
        best = _named(trials, min(trials, key=lambda trial: trial.total, default=state))
        if best.total > state.total - STEP:
            break
        state = best
        if (state.left > FAINT).any():
            suspects = _listed(balance, state, suspected)
            known += suspects
    return state, known


def _reconsidered(
    balance: Balance, state: _State, suspected: Listing
) -> tuple[_State, list[Suspect]]:
    """Each suspect, or what explains more of the same channels beside the others; and those."""
    known: list[Suspect] = []
    for i in range(len(state.suspects) if len(state.suspects) > 1 else 0):
        own, rest = state.suspects[i], _without(balance, state, i)
        channels = _channels(own)
        listed = [s for s in _listed(balance, rest, suspected) if _channels(s) == channels]
        trials = [_with(balance, rest, s) for s in listed]
        best = _named(trials, min(trials, key=lambda trial: trial.total, default=state))
        known += listed
        if best.total < state.total - STEP:
            *others, new = best.suspects
            state = replace(best, suspects=(*others[:i], new, *others[i:]))
    return state, known


def _mirrored(balance: Balance, state: _State, known: Sequence[Suspect]) -> _State:
    """A state, or what explains more of the forces: an encoder's sign for a command's, or back.

    A stiff servo's command is explained by either, all of it, and its force by one. All encoders
    that count backwards are a motion in a mirror, which no step from one to the next arrives at.
    """
    other: dict[tuple[str, int], Suspect] = {}
    for row in balance.rows:
        pair = ("q", row.drive.dof), ("u", row.drive.index)
        for suspect in known:
            for own, counterpart in (pair, pair[::-1]):
                if suspect.kind.endswith("_sign") and _channels(suspect) == {counterpart}:
                    other[own] = suspect
    signs = [
        i
        for i, suspect in enumerate(state.suspects)
        if suspect.kind.endswith("_sign") and set(_channels(suspect)) <= set(other)
    ]
    count, best = len(balance.rows), state
    least = count * balance.misfit(state.edits)
    kinds = {state.suspects[i].kind for i in signs}
    for turned in [*([i] for i in signs), *(_of_kind(state, signs, kind) for kind in kinds), signs]:
        suspects = list(state.suspects)
        for i in turned:
            (channel,) = _channels(suspects[i])
            suspects[i] = other[channel]
        trial = _with_all(balance, tuple(suspects))
        left = count * balance.misfit(trial.edits)
        if left < least - STEP and (trial.left <= np.maximum(state.left, FAINT)).all():
            best, least = trial, left
    return best


def _whole(balance: Balance, state: _State) -> _State:
    """A state in which joints whose positions and commands are exchanged alike are one suspect."""
    dof = {row.drive.index: row.drive.dof for row in balance.rows}
    swaps = [s for s in state.suspects if s.kind in ("positions_swapped", "commands_swapped")]
    for one, other in itertools.permutations(swaps, 2):
        moved = {(e.index, e.source) for e in one.edits}
        sent = {(dof[e.index], dof[e.source]) for e in other.edits if e.group == "u"}
        if moved == sent:
            others = tuple(s for s in state.suspects if s not in (one, other))
            return _whole(balance, _with_all(balance, (*others, whole(one, other))))
    return state


def whole(positions: Suspect, commands: Suspect) -> Suspect:
    """Joints exchanged whole, of their positions and their commands exchanged alike."""
    return Suspect(
        "joints_swapped",
        (*positions.edits, *commands.edits),
        positions.evidence.replace("the positions of ", "the joints ") + ", positions and commands",
        f"{positions.fix}, {commands.fix.partition(', or')[0]}",
        positions.elements,
    )


def _of_kind(state: _State, indices: Sequence[int], kind: str) -> list[int]:
    return [i for i in indices if state.suspects[i].kind == kind]


def _listed(balance: Balance, state: _State, suspected: Listing) -> list[Suspect]:
    """What is suspected beside a state."""
    return [s for s in suspected(balance.undone(state.edits)) if _apart(state, s)]


def _without(balance: Balance, state: _State, i: int) -> _State:
    """A state without one of its suspects."""
    return _with_all(balance, state.suspects[:i] + state.suspects[i + 1 :])


def _channels(suspect: Suspect) -> frozenset[tuple[str, int]]:
    return frozenset((e.group, e.index) for e in suspect.edits)


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
    return _with_all(balance, (*state.suspects, suspect))


def _with_all(balance: Balance, suspects: tuple[Suspect, ...]) -> _State:
    edits = tuple(e for s in suspects for e in s.edits)
    return _State(suspects, balance.unexplained(edits), balance.beyond(edits))


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
        rest = _without(balance, state, i)
        without = rest.left
        ratio = without / np.maximum(state.left, 1e-9)
        own = _own(balance, suspect)
        proven = own & (ratio > DECISIVE) & (without > WRONG) & (state.left < RIGHT)
        if not proven.any():
            clear = (ratio > OVERWHELMING) & (without > FAINT) & (state.left < RIGHT)
            proven = clear & bool((clear & own).any() and clear.sum() > 1)
        if not proven.any():
            # a position may tell little of its own drive, and much of those that carry it
            shown = (ratio > DECISIVE) & (without > FAINT) & (state.left < RIGHT)
            proven = shown & bool((shown & own).any() and (shown & (without > WRONG)).any())
        # a spring that explains about as much as the mix-up is the better guess: over the part of a
        # turn that a joint goes, one may pull as the weight at another angle does, or in another
        # unit; to a servo its own stiffness is such a spring
        servo = np.array([row.drive.servo for row in balance.rows])
        sprung = balance.unexplained(rest.edits, sprung=True)
        proven &= servo | (sprung >= np.minimum(WRONG, DECISIVE * state.left))
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
        if _same(other, suspect) or not _apart(rest, other):
            continue
        total = _with(balance, rest, other).total
        channels = _channels(other)
        if total < min(state.total + _ALIKE, best.get(channels, (np.inf, ""))[0]):
            best[channels] = total, other.evidence
    return [evidence for _, evidence in best.values()]


def _same(one: Suspect, other: Suspect) -> bool:
    """Tell whether two suspects are one, listed twice: a factor is then fitted anew."""
    return (one.kind, len(one.edits)) == (other.kind, len(other.edits)) and all(
        (a.group, a.index, a.source) == (b.group, b.index, b.source)
        and abs(a.factor / b.factor - 1.0) < _REFITTED
        and abs(a.offset - b.offset) <= _REFITTED * abs(a.offset)
        for a, b in zip(one.edits, other.edits, strict=True)
    )


def _own(balance: Balance, suspect: Suspect) -> Bool[np.ndarray, " row"]:
    """Rows that have to show a suspect: those of its own channels, or all if it has none."""
    edited = {(e.group, e.index) for e in suspect.edits}
    own = [
        ("q", row.drive.dof) in edited or ("u", row.drive.index) in edited for row in balance.rows
    ]
    return np.array(own if any(own) else [True] * len(own))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share > 0.005 else "nothing"


def found(subject: Subject, suspected: Listing) -> list[AuditFinding]:
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
        for suspect, said, confidence in search(balance, suspected)
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
