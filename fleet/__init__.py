"""Fleet: a warehouse in which cars and arms share one physical world; all state and all input and output."""

import planners as planners  # finds a place for compiled kernels before anything imports numba
