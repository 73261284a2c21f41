"""The methods that World Translation is compared with: one file a baseline, one interface.

See ``wt.baselines.base`` for the contract and for how to add one.
"""
