"""The networks of World Translation as pure ``nn.Module``s, one file each.

``encoder``, ``film_decoder``, ``blind_decoder``, ``classifier`` and ``translator`` are the
paper's; ``frame`` is what stands between physical units and them; ``world_model`` is all of them
together. The paper's model and ours are the same classes under different settings.
"""
