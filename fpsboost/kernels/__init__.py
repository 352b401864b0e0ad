"""The hot loops: numba over plain contiguous arrays, outputs last, nothing of the package imported."""
