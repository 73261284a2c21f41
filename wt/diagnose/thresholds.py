"""Thresholds: every constant that decides what a diagnosis claims, with its unit and origin.

What merely bounds effort (how many hypotheses get how many steps) stands beside the code that
spends it. "First trials" below are the 43 concealed cases (12 with nothing hidden) by which the
search was set up; "sealed seeds" are later trials of ``wt prove``, whose misses led to a change,
which was then confirmed on a fresh seed (docs/prove.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Thresholds:
    """Constants that decide, in the order in which data flow."""

    # -- recordings --------------------------------------------------------------------------

    encoder_step: float = 2.0 * np.pi / 2000.0
    """[rad or m] Finest quantization worth a finding: an encoder of 2048 counts a turn is finer."""

    filled_in: float = 0.5
    """[share of the error] What replays err by once commands between the samples are filled in, of
    what they err by without, at every driven joint, from which these are believed: a controller
    three times as fast as its log leaves 3 %."""

    # -- residual ----------------------------------------------------------------------------

    slow: float = 0.05
    """[rad/s or m/s] Below this speed presliding decides friction, and a row of the residual does
    not count. Set by first trials: it changes fits, not names."""
    tolerance_box: float = 2.5
    """[standard deviations] Largest deviation that a model's tolerances may take. Set by first
    trials: a ridge prior instead of a box swallowed real effects."""

    # -- likelihood --------------------------------------------------------------------------

    independent_hz: float = 10.0
    """[1/s] Errors of replays that count as independent: a servo remembers for about 0.1 s."""
    law_error: float = 0.005
    """[share of the given model's error] Error that even the right law leaves, since no machine
    follows a law exactly. Set by sealed
    seeds, on which what a right law leaves was taken for something else."""
    law_strength: float = 0.01
    """[share of a strength] Half width below which no interval is believed, for the same reason.
    Set by the coverage of intervals on sealed seeds."""
    shown: float = 1e-3
    """[share of the strongest direction's] Change of replays by a direction of a vector below which
    it is not fitted: an encoder of 5 digits that tells the strongest to one part in a thousand
    tells nothing of it."""
    clean: float = 3.0
    """[times the smallest error] Replays within it leave nothing to explain. Set by first trials:
    outsiders' stand-ins stayed at 5 to 45 times the noise, right names at 1.04."""
    crowded: float = 1.0
    """[times the smallest error] What ``clean`` comes down to where many effects share a joint: the
    error beyond it that is let be falls with their number. Right names leave 1.04; a sum of wrong
    ones gets as near to the noise as it likes, by one effect more."""
    mismatch: float = 0.01
    """[share of a joint's motion] Error below which a replay is not called unexplained, unless the
    force behind it is predicted at times that were not seen: a very quiet sensor sees tolerances.
    """
    moment_calm: float = 2.0
    """[times the mean square of noise] Error of half a second of replays in which nothing acts: as
    much as noise alone makes of half a second by chance."""
    moment_moved: float = 0.9
    """[quantile of calm half seconds] Change of replays by tolerances up to which another half
    second moves as those do: where it moves more, tolerances may be what it errs by."""
    least_moments: int = 2
    """[half seconds] Least that stand out: one may be a single jolt, as where a command jumps."""
    min_nats: float = 12.0
    """[nats] Log-likelihood that an effect must gain beyond the price of its parameters. First
    trials asked for 60; tolerances that adapt inside their box made less do."""
    min_drop: float = 0.15
    """[share] … and of some joint's mean square error that it must remove. Set likewise."""

    # -- selection ---------------------------------------------------------------------------

    replay_share: float = 0.2
    """[share of the best gain] Hypotheses of the screen that are replayed. Set by first trials
    (a quarter there), with a margin."""
    replay_share_floating: float = 0.05
    """[share of the best gain] The same where the base floats and landing feet hide what is faint.
    Set by the legged set."""
    replay_nats: float = 10.0
    """[nats] The same for the best hypotheses of each joint: another joint may just be worse."""
    most_effects: int = 16
    """[1] Effects that a search stops at."""
    many_effects: int = 2
    """[effects a joint] Beyond so many another has to show in recordings left out in turn, too:
    what follows no law exactly has always one more that fits it. Set by an SO-101."""
    equivalent_nats: float = 4.0
    """[nats] Hypotheses closer than this cannot be told apart: odds of 50 to 1."""
    evident_nats: float = 1.0
    """[nats] Lead by which a lookalike takes the place of what was found."""
    material: float = 0.02
    """[share of a joint's squared error] Least that an effect removes of held-out replays: where
    there are data enough, what removes nothing is significant too."""
    momentary_share: float = 0.25
    """[share of the squared error] Least that pushes remove. Their times are read off the very
    recordings that prove them, so that some make up for a little of whatever else is there.
    Set by sealed seeds, on which pushes removed .66 and more and most of what was none .2 and less,
    and by injected ones of a real double pendulum, .28 and more."""
    significant: float = 0.01
    """[1] Largest p-value of a gain that counts, over all effects and searches together."""
    hopeless: float = 0.5
    """[1] p-value of a gain beyond which nothing is to be hoped for: a coin's."""
    mute: float = 0.01
    """[share of the squared error] Held-out data on which an effect could not change more say
    nothing about it. Set by rotors that slow held-out motions do not excite."""
    seldom_excited: float = 0.05
    """[share of its effect on fitted data] The same, relative to what it changes in fitted data:
    a machine that stands tells little of what slows it down."""
    in_turn_share: float = 0.1
    """[share of the squared error] Smallest gain on fitted recordings left out in turn: the search
    has seen them."""
    doubtful: float = 0.6
    """[ratio of mean squares] A name is given up if a nonparametric force leaves less than this
    share of what it leaves. ``tests/diagnose/unknown/test_force.py`` holds right names above
    it and wrong ones below half of it."""
    cancelled: float = 1.0 / 3.0
    """[share of the largest] What laws of one joint's position leave of themselves together, below
    which none of them is believed where a curve does as well. Set by the cubic of a rubber buffer,
    of which a spring and a force make one of a tenth of either."""
    bearing_share: float = 0.8
    """[share of the error] Borne by the joints that are named where nothing explains a machine on
    legs, all of whose joints err together. Set by a foot in glue, which was named twelve times."""

    # -- places and conditions ---------------------------------------------------------------

    joint_active: float = 1.5
    """[times the noise floor] Force residual from which a joint counts as having one."""
    joint_alone: float = 0.9
    """[share of the energy] Residual of one joint that makes it the place."""
    body_explains: float = 0.8
    """[adjusted R²] A body's or gravity's force from which it is the place."""
    joints_together: float = 0.9
    """[share of the energy, and correlation] Residuals that make two joints a pair."""
    stands_out: float = 2.0
    """[times the noise floor] Residual that marks an interval."""
    stands_out_share: float = 0.25
    """[share of the 95th percentile] … unless it is far weaker than the strong parts."""
    condition_contrast: float = 4.0
    """[ratio of mean squares] Residual inside a condition over that outside."""
    condition_chance: float = 1e-3
    """[1] Largest p-value of a condition, over all conditions compared."""

    # -- unknown laws ------------------------------------------------------------------------

    most_unknown: int = 2
    """[1] Unknown laws of one diagnosis."""
    unknown_force: float = 1.5
    """[times the noise floor] Force left at a joint from which a law is looked for."""
    unknown_r2: float = 0.2
    """[share of the force's square] Least that a law predicts in blocks of time it has not seen."""
    unknown_share: float = 0.1
    """[share of the squared error] Least that a law removes of held-out replays, and least that an
    unnamed law must be ahead of a named one before the name is given up for it."""
    same_law: float = 0.05
    """[share of the squared force] A learned law of which named effects say all but this is theirs:
    what a rounded sign or a coarse curve differs by from the friction that it was learned from."""
    unknown_chance: float = 0.05
    """[1] Largest p-value on held-out replays alone; both proofs together must be significant."""
    formula_share: float = 0.9
    """[share of the smooth law's R²] From which the formula acts in its place."""
    term_nats: float = 3.0
    """[nats] Least that a term of a formula gains."""
    term_share: float = 0.02
    """[share of the force's square] … and removes."""

    # -- observed ----------------------------------------------------------------------------

    measured_noise: float = 2.0
    """[times its noise] Difference of a measured force that counts."""
    measured_law: float = 0.03
    """[share of the drive's force] … and what drives are off by."""
    measured_demand: float = 0.05
    """[share of the demanded force] … and what inverse dynamics are off by."""
    measured_small: float = 0.25
    """[share of the largest] One of the three differences is small below this."""
    feature_stands_out: float = 2.5
    """[times the usual distance] Distance of a feature from the translated one from which something
    hidden acted."""


THRESHOLDS = Thresholds()
"""The values in use."""
