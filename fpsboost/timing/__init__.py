"""When frames are shown: output rates, positions, exact schedules."""
