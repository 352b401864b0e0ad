"""A page with passages of a clip before and after a conversion, and with estimates of time and size."""
