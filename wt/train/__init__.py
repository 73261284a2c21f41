"""Training: the mean field, then Algorithm 1 as a LightningModule.

``batches`` draws what step k sees, ``streamed`` from disk, and ``data`` loads it; ``mean_field``
fits the regressors in front of translation; ``module`` reads like Algorithm 1 and calls ``phases``;
``selection`` is what chooses between models; ``hidden`` estimates what was hidden in R, and
``hidden_shift`` is how that goes on; ``logger`` is where metrics end; ``callbacks`` watches for
collapse; ``loop`` runs it under Lightning, with ``replicas``, processes that train together, and
``machines``, those of a Ray cluster; ``fit.fit_world_model`` is the whole of it,
``fit.fitted`` what comes before a Trainer. ``segments`` adds training on stretches
of trajectories, ``online`` goes on while a model is in use, ``translation_only`` translates what is
given.
"""
