"""Policies on robots: ``wt-run`` and the simulated robot that it cannot tell from a real one.

Every 2 ms the runner listens, checks, decides and commands the drives; 50 times a second it asks
the policy. What goes wrong is a fault, and a fault ends in damping.

=====================  =====================================================================
``deploy.robot``       what the runner asks of a robot: the contract, and the recipe below
``deploy.safety``      watchdogs and limits, pure functions
``deploy.stages``      passive → stand up → policy → damping, a pure function
``deploy.watch``       what is known of the robot, and what is wrong with it
``deploy.motion``      what the drives are told in each stage
``deploy.pilot``       the policy: observation, inference in a thread, targets
``deploy.runner``      the control loop
``deploy.operator``    keyboard, remote control (``deploy.remote``), signals
``deploy.go2``         a Go2 over DDS: motors, names, limits
``deploy.idl``         Unitree's messages; ``deploy.messages`` their bytes and checksum
``deploy.dds``         topics on one network interface
``deploy.sim``         a Go2 in MuJoCo (``deploy.sim_robot``) behind the same topics, with a
                       scripted remote control (``deploy.script``) and faults on purpose
                       (``deploy.mischief``)
``deploy.record``      the recording and the log of a run; ``deploy.timing`` its timing report
``deploy.policies``    policies by name; ``deploy.job`` what the commands do
=====================  =====================================================================

Nothing here imports torch: a policy is an ONNX graph and a card.
"""
