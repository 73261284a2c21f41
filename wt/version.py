"""Version of the package, which sources of wheels and clusters compare."""

__version__ = "0.1.0"
