"""Command-line interface of fpsboost."""
