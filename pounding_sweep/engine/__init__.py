"""Kernels for one scene, law and scheme: written, compiled, kept, run, and read out."""
