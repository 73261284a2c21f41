"""The experiment to record next.

Map: ``excite`` designs commands, ``signals`` are what they are made of, ``trial`` replays them to
keep the machine within its limits.
"""
