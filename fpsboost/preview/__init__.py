"""A conversion shown before it is run: some passages of a clip, converted, and what the whole would take."""
