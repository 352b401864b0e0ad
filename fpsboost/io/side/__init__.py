"""What is written beside the frames of a conversion: maps of confidence, and motion."""
