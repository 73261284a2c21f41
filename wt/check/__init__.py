"""Audit: does a model, or a recording, say what it claims, before any physics is suspected?

Map: ``finding`` holds what an audit says; ``audit`` is the contract, its registry and the recipe
for a new one; ``audits`` has one file each; ``reading`` takes files whose stamps go wrong;
``signals`` smooths a recording; ``velocity`` compares velocities with slopes; ``balance`` asks how
much of the commands a model explains, given the motion; ``channels`` searches the mix-ups of
columns that explain the rest; ``run`` does it all in order; ``files`` does it on files and writes
what it corrected, ``page`` the page.

An audit speaks of conventions: a sign, a unit, an order, a clock, gravity left in or out. A factor
near one, a small offset, friction or a delay is physics, and the diagnosis' to name.
"""
