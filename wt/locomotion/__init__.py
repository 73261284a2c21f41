"""Training of walking policies: velocity tracking by rsl_rl's PPO on a herd of robots.

``config`` is the schema of ``conf/policy_*.yaml``, ``feet`` the sensors of the feet for
rewards, ``rewards`` the terms, ``env`` the environment that rsl_rl steps, ``parts`` the same in
several processes, ``mirror`` left and right exchanged, ``train`` the loop with checkpoints,
``evaluate`` the figures of a policy, ``export`` the ONNX file and its card, ``watch`` a recording
for Rerun. Using a policy is the matter of ``wt.worlds.policy``.
"""
