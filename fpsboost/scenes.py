"""Scene cuts."""
