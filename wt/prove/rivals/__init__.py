"""Rivals of ``wt diagnose`` on the same cases: same files, same time, same form of answer.

===========  ===============================================================================
``base``     the interface: from a model and recordings to findings and a patched MJCF
``coulomb``  always says dry friction, at the joint that is worst explained
``sysid``    ``mujoco.sysid`` with every parameter free, and with those that BIC keeps
``sindy``    sparse regression (pysindy) on the residual of inverse dynamics
===========  ===============================================================================

They are helped where that is no part of their method: recordings are smoothed by our code, and
their parameters are written into the MJCF by it. A new rival is a function entered in
``__main__.RIVALS`` and in ``wt.prove.contenders.RIVALS``.
"""
