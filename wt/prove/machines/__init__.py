"""Real machines whose recordings are public: one file each, see :mod:`wt.prove.machines.base`."""
