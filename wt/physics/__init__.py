"""Physics that a model may leave out: what an effect is, and how models are replayed with it.

``effect`` is the contract, the registry and the recipe for adding an effect; ``effects/`` has one
file for each. ``scene`` says what of a model effects need, ``motion`` what a recording reveals at
every sample (for screening); ``replay`` has the nouns of a replay, ``rollout`` simulates many
patched models at once (for deciding), ``quiet`` without MuJoCo's warnings of those that explode.
"""
