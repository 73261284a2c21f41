"""The networks of World Translation as pure ``nn.Module``s, one file each.

``encoder``, ``film_decoder``, ``blind_decoder``, ``classifier`` and ``translator`` are the
paper's; ``frame`` stands between physical units and them, with a mean field that ``simulator_use``
describes; ``world_model`` is all of them together. The paper's model and ours are the same classes
under different settings.
"""
