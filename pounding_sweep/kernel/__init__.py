"""Kernels: plain functions over lanes of scenarios, run on NumPy arrays as they stand, or traced into machine code."""

import time

#: When this process began to read the sources of kernels (s since 1970).
READ = time.time()
