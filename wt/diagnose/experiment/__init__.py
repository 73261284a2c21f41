"""The experiment to record next.

Map: ``excite`` designs commands, ``signals`` are what they are made of, ``trial`` replays them to
keep the machine within its limits.
"""

SOURCE = "wt diagnose --suggest-experiment"
"""What the metadata of a suggested recording name as its source."""
