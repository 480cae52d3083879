"""Kernels: plain functions over lanes of scenarios, run on NumPy arrays as they stand, or traced into machine code."""
