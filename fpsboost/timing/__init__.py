"""Timing of frames: output rates, positions, exact schedules.

All times are `fractions.Fraction` seconds, so that nothing is rounded and hours of 23.976 frames per second stay exact.
Nothing here imports NumPy or reads files of frames: the command line and ``--help`` start with it.

>>> from fractions import Fraction
>>> from fpsboost.timing.schedule import ByRate
>>> steps = ByRate(Fraction(60)).steps(0, Fraction(0), Fraction(0), Fraction(1, 24))  # a pair of a clip at 24
>>> [(str(step.time), str(step.t)) for step in steps]  # presentation times, and positions within the pair
[('0', '0'), ('1/60', '2/5'), ('1/30', '4/5')]
"""
