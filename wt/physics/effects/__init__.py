"""One file an effect; each registers itself. How to add one stands in ``wt.physics.effect``."""
