"""The likelihood of a hypothesis, by replaying the recordings.

Map: ``objective`` replays and assesses; ``replays`` makes coarse steps do for fine ones;
``adapt`` lets initial states and ``tolerances`` adapt; ``weights`` says how much a sample counts;
``refine`` and ``estimate`` fit parameters; ``bic`` is the price of having them.
"""
