"""Readable parts of every kernel.

The text of these modules is appended to the header that the emitter writes for
a kernel (slot numbers, law expressions, switches), so a compiled kernel is one
self-contained file and its text is the key of its cache.
"""
