"""Motion vectors in files: those that a renderer writes, and those that are written for other programs."""
