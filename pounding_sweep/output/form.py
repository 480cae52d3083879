"""Whether a netCDF file has the form of the files of this package, told from its header before values are read.

A damaged or hostile file may name types, sizes and attributes that make the libraries
above take all memory or fail anywhere later; here it is refused, with what is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.outputs.variables import VARIABLES

if TYPE_CHECKING:
    import netCDF4

#: No compressed file holds more bytes per byte of its own: the limit of deflate, and something for headers.
MOST_PACKED = 1100
#: Attributes of variables that change what is read; this package writes none of them.
_RECODING = ("scale_factor", "add_offset", "dtype", "_Unsigned", "missing_value", "valid_range")
#: Values of an axis at most, characters of a text, and of all texts together: they are in memory while a cube is open.
LONGEST_AXIS, LONGEST_TEXT, MOST_CHARACTERS = 2**24, 2**12, 2**29
#: How characters are to be read.
ENCODING = "utf-8"
#: Attributes that are text where they are there.
_TEXTS = ("units", "unit_text", "long_name", "coordinates", "standard_name", "comment")
#: Numbers of the audit among the attributes of a cube.
_AUDIT_NUMBERS = ("audit_touching", "audit_share", "audit_perturbation", "audit_undecided_share")


def wrong_form(file: netCDF4.Dataset, size: int) -> str | None:
    """Say what in a netCDF file's header is not as this package writes it; None if nothing is.

    Parameters
    ----------
    file : netCDF4.Dataset
        The file, open; the caller holds the lock of the library.
    size : int
        Its bytes.

    Returns
    -------
    str or None
        The first fault: a type that is neither number nor text, more values than the file
        can hold, attributes that would change what is read, an audit that is not whole.

    Raises
    ------
    Exception
        Whatever the library raises at a file that it can't read.
    """
    return next(_faults(file, size), None)


def _faults(file: netCDF4.Dataset, size: int) -> Iterator[str]:
    if file.groups or file.cmptypes or file.vltypes or file.enumtypes:
        yield "it has groups, or types of its own"
    texts = sum(variable.size for variable in file.variables.values() if _is_of_characters(variable))
    if texts > MOST_CHARACTERS:
        yield f"its texts have {texts} characters, more than {MOST_CHARACTERS}"
    for name, variable in file.variables.items():
        dtype: Any = variable.dtype
        if dtype is not str and dtype.kind not in "iufS":
            yield f"variable {name!r} has type {dtype}, neither number nor text"
        labels = variable.dimensions[:1] == (name,)  # names of statuses, along which a trade counts
        characters = _is_of_characters(variable)
        if name in VARIABLES and not labels and (dtype is str or characters):
            yield f"variable {name!r} is text"
        if len(set(variable.dimensions)) < len(variable.dimensions):
            yield f"variable {name!r} has a dimension twice"
        count = math.prod(len(dim) for dim in variable.get_dims())
        most = size if variable.chunking() == "contiguous" else MOST_PACKED * size
        if count * (1 if dtype is str else dtype.itemsize) > most:
            yield f"variable {name!r} has {count} values, more than a file of {size} bytes can hold"
        if labels and len(variable) > LONGEST_AXIS:
            yield f"axis {name!r} has {len(variable)} values, more than {LONGEST_AXIS}"
        if characters and variable.shape and variable.shape[-1] > LONGEST_TEXT:
            yield f"texts of {name!r} have {variable.shape[-1]} characters, more than {LONGEST_TEXT}"
        attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
        for key in _RECODING:
            if key in attributes:
                yield f"variable {name!r} has an attribute {key!r}"
        if attributes.get("_Encoding") != (ENCODING if characters else None):
            yield f"variable {name!r} has {'no' if characters else 'an'} attribute '_Encoding' of {ENCODING!r}"
        for key in _TEXTS:
            if not isinstance(attributes.get(key, ""), str):
                yield f"attribute {key!r} of variable {name!r} is no text"
    yield from _audit_faults(file)


def _is_of_characters(variable: netCDF4.Variable) -> bool:
    return variable.dtype is not str and bool(variable.dtype.kind == "S")


def _dimensions(variable: netCDF4.Variable) -> tuple[str, ...]:
    """Return the dimensions of a variable's values; characters of a text are no values."""
    dimensions: tuple[str, ...] = variable.dimensions
    return dimensions[:-1] if _is_of_characters(variable) else dimensions


def _audit_faults(file: netCDF4.Dataset) -> Iterator[str]:
    """Find what is missing of an audit that is there in part."""
    if "audit_error" not in file.variables:
        return
    if set(file["audit_error"].dimensions) != set(AUDIT_DIMS):
        yield f"variable 'audit_error' has dimensions {file['audit_error'].dimensions}, not {AUDIT_DIMS}"
    sample, outputs = AUDIT_DIMS
    for name, dimension in (("audit_sensitive", sample), ("audit_undecided", sample), ("output", outputs)):
        if name not in file.variables or _dimensions(file[name]) != (dimension,):
            yield f"variable {name!r} is missing, or is not along {dimension!r}"
    for name in _AUDIT_NUMBERS:
        value = file.getncattr(name) if name in file.ncattrs() else None
        if not isinstance(value, (int, float, np.number)):
            yield f"attribute {name!r} is {value!r}, no number"
