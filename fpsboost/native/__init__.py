"""Kernels in C++, which are compiled when fpsboost is installed; `fpsboost.kernels` calls them."""
