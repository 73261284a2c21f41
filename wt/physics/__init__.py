"""Physics that a model may leave out: what an effect is, and how models are replayed with it.

``effect`` is the contract, the registry and the recipe for adding an effect; ``hooks`` has the base
classes of effects that take more than a signature and a patch, ``effects/`` one file for each.
``scene`` is a model as effects see it, ``motion`` a recording at every sample (for screening).
``parts`` adds to an MJCF what no class of the user's reaches.

``planted`` is an effect at a place, as replays need it, ``replay`` has a replay's other nouns.
``rollout`` simulates many patched models at once (for deciding), limbs that hang apart each by
itself (``limbs``), ``quiet`` without MuJoCo's warnings of those that explode; ``runner`` is who
runs them, and ``spread`` chooses it: threads, or a Ray ``cluster``. Imports go in this order:
parts, scene, motion, replay, effect, hooks, planted, runner, limbs, rollout, cluster, spread.
"""
