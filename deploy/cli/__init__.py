"""The commands of the runner: ``wt-run`` and ``wt-sim-go2``, one module each."""
