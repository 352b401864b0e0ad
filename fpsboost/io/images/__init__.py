"""Numbered images, read and written one at a time, with what they say beside their pixels."""
