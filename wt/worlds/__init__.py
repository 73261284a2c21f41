"""Worlds: one file a task, found by itself; see ``wt.worlds.base`` for the contract."""
