"""Sweeps: from a description to a plan, its execution and the chunks on disk."""
