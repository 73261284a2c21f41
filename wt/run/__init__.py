"""One run of ``wt fit``, on disk and on record.

Map: ``folder`` is the folder of a run; ``study`` the methods and seeds that it trains;
``jobs`` their trainings, side by side in the processes of ``pool``; ``publish`` its registered
model; ``track`` its MLflow record.
"""
