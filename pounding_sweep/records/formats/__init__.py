"""The formats of record files: every module of this folder has one as its `READER`."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from pounding_sweep.records.reader import HEAD, Reader, RecordText

READERS: tuple[Reader, ...] = tuple(
    import_module(f"{__name__}.{module.name}").READER for module in pkgutil.iter_modules(__path__)
)
"""Readers of all formats."""

RECORD_SUFFIXES = tuple(dict.fromkeys(suffix for reader in READERS for suffix in reader.suffixes))
"""File name endings taken for record files when a folder is searched."""


def reader_of(source: RecordText) -> Reader:
    """Tell the format of a file by its first lines."""
    head = source.lines[:HEAD]
    (rest,) = (reader for reader in READERS if reader.matches is None)
    return next((reader for reader in READERS if reader.matches is not None and reader.matches(head)), rest)
