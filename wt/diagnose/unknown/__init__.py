"""A force that no known effect explains, learned and written down.

Map: ``force`` looks for it; ``choice`` chooses the columns that it depends on, ``fit`` regresses
on them; ``law`` is what comes out, ``formula`` its readable form, ``memory`` its hidden state, and
``onnx`` its graph.
"""
