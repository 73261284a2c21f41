"""One run of ``wt fit``, on disk and on record.

Map: ``folder`` is what a run leaves behind; ``study`` the methods and seeds that it trains;
``jobs`` their processes; ``publish`` its registered model; ``track`` its MLflow record.
"""
