"""Regions that are worth rendering: which they are, and how rendered regions are put back.

`planning` finds the regions of interpolated frames that are most likely wrong, within a budget; `merging` puts them
back after they were rendered.
"""
