"""Compiled time stepping: kernels generated per scene shape, law, scheme and outputs."""
