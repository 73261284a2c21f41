"""The walking task: one legged robot under a trained policy, in two domains.

``world`` is the task; ``options`` its section of a configuration; ``state`` reads hidden variables
off a simulation and restores it from them; ``episodes`` collects transitions, ``recording`` what an
estimator would have recorded meanwhile, and ``rollout`` closes the loop over the policy.
"""
