"""Timing of frames: output rates, positions, exact schedules."""
