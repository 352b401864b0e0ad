"""Frame-rate conversion by non-local means motion."""

__version__ = "0.1.0"
