"""How large a drift of one unit has to be to be told, and how often one is told that is none.

Made-up estimates of twelve units, six parameters each. Of one unit one parameter makes a step in
its fourth session; it is to be told then or in the next. And fleets in which nothing changes, but
sessions that differ anyway. Errors are what the estimates say of themselves: they scatter by them
from session to session, or by less, where most of an error is the same in all of a unit's sessions,
as that of its masses is.

Usage: python benchmarks/drift.py [DRAWS [SEED...]]
"""

from __future__ import annotations

import sys

import numpy as np

from wt.passport.changes import Tables, judged
from wt.passport.estimates import Quantity
from wt.passport.levels import Sessions

UNITS, PARAMETERS, STEP_AT, DAYS = 12, 6, 3, 3
SIZES = (3.0, 4.0, 5.0, 6.0)
FLEETS = ((1, 6, 0.0), (3, 4, 0.0), (3, 4, 3.0), (6, 5, 1.0), (12, 6, 0.0), (12, 6, 3.0))
"""Units, sessions, and what sessions differ by anyway, in errors."""


def drawn(
    rng: np.random.Generator, units: int, sessions: int, said: float, usual: float = 0.0,
    step: float = 0.0,
) -> Tables:  # fmt: skip
    """Estimates, three days apart, whose errors scatter about 1.

    Args:
        rng: source of all that is random.
        units: how many.
        sessions: of each.
        said: errors that the estimates say of themselves, over those with which they scatter.
        usual: standard deviation between sessions in which nothing changes.
        step: of the first unit, in its first parameter, in said errors.
    """
    keys = tuple((f"u{u:02d}", f"2026-01-{1 + DAYS * s:02d}") for u in range(units)
                 for s in range(sessions))  # fmt: skip
    tables = {}
    for i in range(PARAMETERS):
        error = rng.uniform(0.7, 1.4, len(keys))
        value = 10.0 + np.hypot(error, usual) * rng.standard_normal(len(keys))
        if i == 0:
            value[STEP_AT:sessions] += step * said
        at = Quantity("joint.friction_coulomb", "joint", f"j{i}", "coulomb", "N·m")
        tables[at] = Sessions(keys, value, said * error)
    return tables


def alarms(tables: Tables, sessions: int) -> set[tuple[str, str]]:
    """Units and places with an alarm in their last session, had there been so many."""
    last = f"2026-01-{1 + DAYS * (sessions - 1):02d}"
    until = {q: t.where(np.array([key[1] <= last for key in t.keys])) for q, t in tables.items()}
    return {(unit, q.place) for unit, of in judged(until).items() for q, one in of.items()
            if one.changed or one.drifts}  # fmt: skip


def told(seed: int, draws: int, said: float, step: float) -> tuple[int, int]:
    """Draws in which the step is told in its session, and in that or the next."""
    rng = np.random.default_rng([seed, round(10.0 * said), round(10.0 * step)])
    at_once = in_time = 0
    for _ in range(draws):
        tables = drawn(rng, UNITS, STEP_AT + 2, said, step=step)
        found = [("u00", "j0") in alarms(tables, STEP_AT + n) for n in (1, 2)]
        at_once, in_time = at_once + found[0], in_time + any(found)
    return at_once, in_time


def false(seed: int, draws: int, units: int, sessions: int, usual: float) -> tuple[int, int]:
    """Unit-sessions with an alarm though nothing changed, and how many there were."""
    rng = np.random.default_rng([seed, units, sessions, round(usual)])
    raised = 0
    for _ in range(draws):
        tables = drawn(rng, units, sessions, 1.0, usual)
        raised += sum(len({u for u, _ in alarms(tables, s)}) for s in range(2, sessions + 1))
    return raised, draws * units * sessions


def main(draws: int = 5, *seeds: int) -> None:
    """Print both tables."""
    seeds = seeds or (1, 2, 3)
    count = draws * len(seeds)
    print(f"told in its session, in it or the next; {count} draws a size, seeds {seeds}")
    for said in (1.0, 2.0):
        print(f"errors {said:g} × the scatter of sessions")
        for step in SIZES:
            hits = np.sum([told(seed, draws, said, step) for seed in seeds], axis=0)
            shares = "".join(f"{100 * n / count:7.0f} %" for n in hits)
            print(f"  step of {step:g} errors{shares}", flush=True)
    print("alarms though nothing changed, of unit-sessions")
    for units, sessions, usual in FLEETS:
        each = max(1, draws * UNITS // units)
        raised, of = np.sum([false(s, each, units, sessions, usual) for s in seeds], axis=0)
        print(f"  {units} units, {sessions} sessions that differ by {usual:g} errors: {raised} of "
              f"{of}, {100 * raised / of:.2f} %", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
