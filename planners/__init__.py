"""Planners: pure algorithms on arrays and graphs, in families that do not know each other."""

from planners.kernel_cache import provide_kernel_cache

provide_kernel_cache()  # before anything imports numba
