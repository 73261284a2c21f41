"""The objectives as pure functions; each formula stands over its line in the paper's symbols.

``vae``: reconstruction, KL, blind penalty, domain classification. ``gan``: adversarial, cycle
and identity losses. ``robust``: the mode-seeking regression loss of our mean field.
"""
