"""Numbered images, read and written one at a time, with their metadata."""
