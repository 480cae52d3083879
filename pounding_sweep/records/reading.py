"""Reading record files as they are published: format by content, units, scaling."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from pounding_sweep.base.errors import RecordError, shown
from pounding_sweep.base.paths import expanded
from pounding_sweep.records.formats import reader_of
from pounding_sweep.records.reader import Content, fail, in_quotes, load_text
from pounding_sweep.records.record import UNITS, Record, match_unit, number, require_unit

_UNITS_STATED = re.compile(r"\bunits?\b(?:\s+(?:of|in|is|are))?\s*[:=]?\s*[(\[]?([^,;()\[\]\n]{1,24})", re.IGNORECASE)
_BRACKETED = re.compile(r"[(\[]([^()\[\]\n]{1,24})[)\]]")


def read_record(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    units: str | None = None,
    scale: float = 1.0,
    pga: float | None = None,
) -> Record:
    r"""Read one ground-motion record from a file.

    PEER AT2 (old and NGA headers), two columns of time and acceleration (CSV or separated by blanks, at a constant
    step), one column of acceleration with `dt`, or another format of `pounding_sweep.records.formats`. The content
    decides, not the file name. Headings tell time from acceleration, whichever is first.

    Parameters
    ----------
    path
        The file, of at most 64 MiB and 10,000,000 points.
    name
        Label of the record; by default the file name, without its ending unless that tells the component.
    dt
        Time step in s. Needed for one column, or a column of numbers 0, 1, 2 ... and one of acceleration,
        without ``DT=`` in the header; where the file has a step, it must agree.
    units
        Units of the file: "g" (9.81 m/s2), "m/s2" or "cm/s2" ("gal"). Needed where the header
        doesn't state them; AT2 files are in g. Where the header does, both must agree.
    scale
        Factor on the motion.
    pga
        Peak ground acceleration to scale to, in m/s2; excludes `scale`.

    Returns
    -------
    Record
        Acceleration in m/s2; the first point is at time 0.

    Raises
    ------
    MissingRecordError
        If there is no such file.
    RecordError
        If the file can't be read, holds no record, holds fewer or more points than its header says, values that are not
        finite, an uneven time step, times that are not in seconds, or if time step or units are not known.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "demo.csv")
    ...     _ = file.write_text("time (s),acc (g)\n0.00,0.0\n0.01,0.2\n0.02,-0.1\n")
    ...     read_record(file, scale=0.5)
    Record('demo', 3 points, dt=0.01 s, PGA 0.981 m/s2)
    """
    try:
        file = expanded(path, RecordError)
    except TypeError:
        msg = f"a record's path must be a text or a path, not {shown(path)}"
        raise RecordError(msg) from None
    if pga is not None and scale != 1.0:
        msg = f"{file}: scale={scale!r} and pga={pga!r} exclude each other; give one of them"
        raise RecordError(msg)
    given_units = None if units is None else require_unit(units)
    given_dt = None if dt is None else number(dt, f"{file}: dt (s)", positive=True)
    source_text = load_text(file, file.stem if name is None else name)
    content = reader_of(source_text).parse(source_text, given_dt)
    label = (content.name or file.stem) if name is None else name
    factor = UNITS[_choose_units(file, content, given_units)]
    with np.errstate(over="ignore"):
        motion = content.values * factor
    source = f"{content.title[:200]} ({file.name})" if content.title else file.name
    try:
        record = Record(label, content.dt, motion, source)
        return record.scaled_to(pga) if pga is not None else record.scaled(scale)
    except RecordError as error:
        fail(file, str(error))


def _header_units(header: str) -> tuple[str | None, str]:
    """Find the acceleration unit a header states; else the text it has in that place."""
    stated = [match.strip() for match in _UNITS_STATED.findall(header)]
    phrases = [" ".join(words[:n]) for text in stated for words in [text.split()] for n in range(len(words), 0, -1)]
    last = header.rpartition("\n")[2]
    columns = re.split(r"[,;]", last)
    words = re.split(r"[\s,;]+", last)
    tails = [word.split("_", n)[n].replace("_", "/") for word in words for n in range(1, word.count("_") + 1)]
    tiers = [phrases, _BRACKETED.findall(columns[-1]), _BRACKETED.findall(header), words + tails]
    for tier in tiers:
        found = {unit for text in tier if (unit := match_unit(text))}
        if len(found) == 1:
            return found.pop(), ""
        if tier is phrases and phrases:
            return None, stated[0]
        if found:
            break
    return None, last.strip()


def _choose_units(file: Path, content: Content, given: str | None) -> str:
    found, text = _header_units(content.header)
    if found and given and found != given:
        fail(file, f"its header says {found!r}, units={given!r} was given; leave units out, or mend the header")
    if found or given:
        return found or given or ""
    stated = bool(_UNITS_STATED.search(content.header))
    if content.default_units and not stated:
        return content.default_units
    said = f"; its header says {in_quotes(text)}" if text else ""
    fail(file, f"its units are not known{said}; give units= one of {', '.join(map(repr, UNITS))}")
