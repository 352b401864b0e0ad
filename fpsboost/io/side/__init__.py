"""Side outputs of a conversion: maps of confidence, and motion."""
