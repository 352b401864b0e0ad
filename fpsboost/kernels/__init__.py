"""Numba kernels: hot loops over plain contiguous arrays, with outputs last and no other imports from the package."""
