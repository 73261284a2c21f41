"""Selection: the effects that are claimed, and why.

Map: ``candidates`` proposes; ``search`` adds and prunes; ``alternatives`` compares laws that look
alike, ``simpler`` those that say less; ``holdout`` proves on recordings that nothing was fitted to;
``naming`` doubts what was found, and ``claims`` are what stands; ``events`` finds what happens at
moments of its own; ``verdict`` sums up; ``locate`` and ``condition`` say where and when.
"""
