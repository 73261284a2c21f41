"""The force residual, on which thousands of hypotheses are compared in seconds.

Map: ``screen`` computes and ranks; ``scoring`` is the linear algebra of a comparison;
``signature`` the force of an effect with given parameters.
"""
