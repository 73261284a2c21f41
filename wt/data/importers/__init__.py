"""Importers: one file a foreign format, found by itself; see ``wt.data.importers.base``."""
