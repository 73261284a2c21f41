"""The model registry: ONNX models with a card, in MLflow, and nothing that is ever unpickled.

======================  =====================================================================
``registry.card``       what travels beside a model: names, units, hashes, metrics, golden pairs
``registry.parity``     does the ONNX graph compute what the model computed? is a folder whole?
``registry.backend``    the MLflow store that runs and models share, and how it is reached
``registry.mlmodel``    a model's folder as ``mlflow.pyfunc`` and ``mlflow.onnx`` load it
``registry.served``     what runs a graph there; travels with each model
``registry.reference``  how a model is named: of the registry, or by a folder
``registry.store``      registered models: the only user of MLflow's registry API
``registry.push``       register a model; ``champion`` moves only to a better one
``registry.pull``       fetch a model and verify every byte of it
``registry.policies``   the same for walking policies
======================  =====================================================================

A model is a folder with ``model.onnx`` and ``card.json``. It is called ``wt-r5/3`` (a version)
or ``wt-r5@champion`` (an alias).
"""
