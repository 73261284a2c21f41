"""World Translation: when a simulator and a robot disagree, translate between them.

Map of the package (each concept has one home):

=====================  =====================================================================
``wt.types``           the frozen nouns that travel between stages: Recording, Transitions, Pairs
``wt.errors``          one class per mistake a user can make; each carries what to do next
``wt.config``          what ``conf/*.yaml`` may say, checked before anything runs
``wt.worlds``          one file a task: robot model, two domains, hidden variable, policy
``wt.data``            recordings, importers, collection on disk, normalisation, batches
``wt.nets``            encoder, FiLM decoder, blind decoder, classifier, translator
``wt.losses``          the paper's objectives as pure functions
``wt.train``           Algorithm 1 as a LightningModule, its phases and callbacks
``wt.translate``       simulation → reality on tensors: shared by evaluation, export, deploy
``wt.baselines``       what translation is compared with, one file each, one interface
``wt.evaluate``        single-step tables, figures, Rerun recordings
``wt.export``          the ONNX graph with its normaliser inside
``wt.cli``             one module a command
=====================  =====================================================================

The model registry is its own package, ``registry``; it needs nothing of this one but types.
"""

__version__ = "0.1.0"
