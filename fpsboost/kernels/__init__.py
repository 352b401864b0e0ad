"""Kernels: hot loops over plain contiguous arrays, in C++, with outputs last and no other imports from the package."""
