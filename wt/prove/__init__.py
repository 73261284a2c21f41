"""Concealed trials: worlds with hidden physics, sealed answers, blind diagnoses, and their score.

The hidden worlds share no code with ``wt.physics`` and none with ``wt.diagnose``: their effects
are integrated here, on bare MuJoCo stepping without actuators, by other laws than a fitter uses.
Agreement between the two is therefore evidence, and a wrong sign in either cannot pass.

The worlds:

=================  ==========================================================================
``rigs``           the robots: nominal MJCF, servo gains, names, the poses they move around
``motions``        reference motions within limits
``sets``           which effects on which rig: the rows of every set
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
``real``           real machines as cases; ``bring`` those of other people
=================  ==========================================================================

The trial (``wt prove``), in the order in which things happen:

=================  ==========================================================================
``bench``          the phases: make and seal, diagnose blind, record, open; ``folder`` on disk
``answer, seal``   what is hidden, as JSON; encrypted and committed to
``blind, guard``   a process that sees its own files only, and the walls around it
``contenders``     who competes; ``rivals`` on the same files
``sysid_rival``    ``mujoco.sysid``, told what to fit; ``sysid_ranges`` between which values
``score``          marks of one diagnosis; ``machine`` knows which names are one place
``replay``         held-out recordings on a patched MJCF, in plain MuJoCo
``marks, tally``   one row a case; from rows to shares, medians, curves
``finish``         ``results`` as JSON and table, ``page`` (and ``page_tables``), ``film``
=================  ==========================================================================

Adding a case: a row at the end of ``sets``. Adding an effect: a law in one of the ``*_laws``
modules, entered by its id in that module's ``LAWS``, its magnitudes in ``catalog`` and its places
in ``places``.
"""
