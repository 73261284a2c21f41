"""Ask the robot: the next experiment is designed for what is still open, run, and diagnosed.

Map: ``alive`` are the hypotheses that recordings leave; ``separation`` is how far an experiment is
expected to tell them apart; ``design`` chooses a safe experiment by it; ``robot`` is what carries
it out; ``loop`` is the work in order, and ``text`` says what came of it. ``plan`` asks before
anything is recorded: which causes could be told apart at all; ``plan_page`` shows it.
"""

SOURCE = "wt ask"
"""What the metadata of a designed experiment name as its source."""
