"""Reading record files as they are published: format by content, unit and step from where they stand, scaling."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace

import numpy as np

from pounding_sweep.base.errors import RecordError, shown, unknown
from pounding_sweep.base.files import expanded
from pounding_sweep.records.formats import reader_of
from pounding_sweep.records.reader import LAYOUTS, fail, load_text
from pounding_sweep.records.record import Reading, Record, number
from pounding_sweep.records.units import UNITS, choose_unit, require_unit


def read_record(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    units: str | None = None,
    scale: float = 1.0,
    pga: float | None = None,
    column: str | int | None = None,
    layout: str | None = None,
) -> Record:
    r"""Read one ground-motion record from a file.

    PEER AT2, the formats of networks in `pounding_sweep.records.formats`, columns of time and acceleration (CSV or
    separated by blanks, at a constant step), or acceleration alone. The content decides, not the file name. Headings
    tell time from acceleration, whichever is first. ``record.reading`` says where unit and step were read.

    Parameters
    ----------
    path
        The file, of at most 64 MiB and 10,000,000 points.
    name
        Label of the record; by default the file name, without its ending unless that tells the component.
    dt
        Time step in s. Needed where the file states none; where its times or the header of its format do, it must agree
        with them. It takes precedence over remarks, and over times that it explains to their last printed place.
    units
        Unit of the file: "g" (9.81 m/s2), "mg", "%g", "m/s2", "cm/s2" ("gal") or "mm/s2". Needed where the file states
        none, or several. It takes precedence over what the file states, with a warning.
    scale
        Factor on the motion.
    pga
        Peak ground acceleration to scale to, in m/s2; excludes `scale`.
    column
        Which of several components: a heading, or the number of the column in the file, from 1.
    layout
        "rows" for one component whose values wrap in rows of several; "columns" otherwise.

    Returns
    -------
    Record
        Acceleration in m/s2; the first point is at time 0.

    Raises
    ------
    MissingRecordError
        If there is no such file.
    RecordError
        If the file can't be read, holds no record, velocity or displacement, fewer or more points than its header says,
        values that are not finite, an uneven time step, times that are not in seconds, several components without
        `column`, or if time step or units are not known.

    Warns
    -----
    UserWarning
        If `units` takes precedence over another unit in the file.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "demo.csv")
    ...     _ = file.write_text("time (s),acc (g)\n0.00,0.0\n0.01,0.2\n0.02,-0.1\n")
    ...     record = read_record(file, scale=0.5)
    >>> record
    Record('demo', 3 points, dt=0.01 s, PGA 0.981 m/s2)
    >>> print(record.reading)
    unit g: 'acc (g)', line 1; step: 'time (s)', line 1
    """
    try:
        file = expanded(path, RecordError)
    except TypeError:
        raise RecordError(f"a record's path must be a text or a path, not {shown(path)}") from None
    if pga is not None and scale != 1.0:
        raise RecordError(f"{file}: scale={scale!r} and pga={pga!r} exclude each other; give one of them")
    wanted = None if units is None else require_unit(units)
    step = None if dt is None else number(dt, f"{file}: dt (s)", positive=True)
    if layout is not None and layout not in LAYOUTS:
        raise RecordError(unknown("layout", layout, LAYOUTS))
    source = replace(load_text(file, file.stem if name is None else name), dt=step, column=column, layout=layout)
    try:
        content = reader_of(source).parse(source)
    except RecordError:
        raise
    except (ArithmeticError, ValueError, LookupError) as error:  # numbers of a header that are none
        fail(file, f"its header is damaged ({error}); get the file again")
    label = (content.name or file.stem) if name is None else name
    try:
        unit, unit_from = choose_unit(content.units, content.default_unit, wanted, content.header)
        if "in place of" in unit_from:
            warnings.warn(f"{file}: units={wanted!r} is {unit_from}", UserWarning, stacklevel=2)
        with np.errstate(over="ignore"):
            motion = content.values * UNITS[unit]
        title = f"{content.title[:200]} ({file.name})" if content.title else file.name
        reading = Reading(unit, unit_from, content.step[1], content.column)
        record = Record(label, content.step[0], motion, title, reading=reading)
        return record.scaled_to(pga) if pga is not None else record.scaled(scale)
    except RecordError as error:
        fail(file, str(error))
