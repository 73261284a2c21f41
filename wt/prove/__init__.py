"""Concealed trials: worlds with hidden physics, made from a seed, and the marking of answers.

The hidden worlds share no code with ``wt.physics`` and none with ``wt.diagnose``: their effects
are integrated here, on bare MuJoCo stepping without actuators, by other laws than a fitter uses.
Agreement between the two is therefore evidence, and a wrong sign in either cannot pass.

=================  ==========================================================================
``rigs``           the robots: nominal MJCF, servo gains, names, the poses they move around
``motions``        reference motions within limits
``cases``          what is hidden where: ``cases(set, seed)``
``catalog``        for every effect: seeded magnitudes
``places``         for every effect: where it can be told, and motions that show it
``scales``         how much torque, speed and travel a rig's motions have
``hidden``         one fine-stepped world: bodies, servo, drives, joints, forces
``drive_laws``     what acts between the command and the joint
``joint_laws``     what acts at a joint
``body_laws``      what acts on bodies and between joints
``sensing``        encoders, clocks, noise
``world``          ``build(case)``: recordings as a user would have them
``score``          ``score(diagnosis, case)``
=================  ==========================================================================

Adding an effect: a law in one of the ``*_laws`` modules, entered by its id in that module's
``LAWS``, its magnitudes in ``catalog`` and its places in ``places``.
"""
