"""Kernels: compiled code of planning on open floors, and the arrays that it works on."""
