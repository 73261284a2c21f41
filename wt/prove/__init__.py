"""Concealed trials: worlds with hidden physics, sealed answers, blind diagnoses, and their score.

The hidden worlds share no code with ``wt.physics`` and none with ``wt.diagnose``: their effects
are integrated here, on bare MuJoCo stepping without actuators, by other laws than a fitter uses.
Agreement between the two is therefore evidence, and a wrong sign in either cannot pass.

The worlds:

=================  ==========================================================================
``rigs``           the robots: nominal MJCF, servo gains, names, the poses they move around
``motions``        reference motions within limits
``case_spec``      one line of a set: effects, rig, level, kind, decoy
``sets``           the specifications of every set
``cases``          the cases drawn from them: ``cases(set, seed)``
``catalog``        for every effect: seeded magnitudes
``places``         for every effect: places that set it apart, and motions that show it
``scales``         torque, speed and travel of a rig's motions
``hidden``         one fine-stepped world: bodies, servo, drives, joints, forces
``drive_laws``     laws between the command and the joint
``joint_laws``     laws at a joint
``body_laws``      laws on bodies and between joints
``trajectory``     the true motion of a hidden world
``sensing``        encoders, clocks, noise
``world``          ``build(case)``: recordings as a user would have them
``asked``          the machine of a case, for who may ask it for experiments
``fleet``          many units of a machine over sessions
``real``           real machines as cases; ``bring`` those of other people
=================  ==========================================================================

The trial (``wt prove``), in the order in which things happen:

=================  ==========================================================================
``bench``          the phases: make and seal, diagnose blind, record, open; ``folder`` on disk
``answer, seal``   the hidden effects as JSON; encrypted and committed to
``blind, guard``   a process that sees its own files only, and the walls around it
``contenders``     the contenders; ``rivals`` on the same files
``sysid_rival``    ``mujoco.sysid`` with given free parameters; ``sysid_ranges`` their ranges
``score``          marks of one diagnosis; ``machine`` knows which names are one place
``replay``         held-out recordings on a patched MJCF, in plain MuJoCo
``marks``          the ``case_result`` of every case; ``fleet_marks`` of a passport
``tally``          from those to shares, medians, curves
``finish``         ``results`` as JSON and table, ``page`` (and ``page_tables``), ``film``
=================  ==========================================================================

Adding a case: a specification at the end of ``sets``. Adding an effect: a law in one of the
``*_laws`` modules, entered by its id in that module's ``LAWS``, its magnitudes in ``catalog`` and
its places in ``places``.
"""
