"""One robot over units, days and loads: what belongs to the model, the unit, the session, the load.

Map: ``estimates`` estimates the same effects in every group of recordings; ``levels`` puts each
parameter at the highest level that explains it, and ``drift`` says what changed: both are pure
statistics; ``folder`` keeps all of it, append-only; ``card`` is what it says of each unit, ``text``
and ``page`` show it, and ``add`` is the work in order.
"""
