"""The version of the package, and nothing else: whoever asks for it imports nothing."""

__version__ = "0.1.0"
