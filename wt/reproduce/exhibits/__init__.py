"""The report's tables and figures: one file each, found by itself; see ``wt.reproduce.exhibit``."""
