"""The backbone of a storey from a pushover curve, by the rules of ASCE 41-17."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import FilePath, expanded, read_data
from pounding_sweep.base.text import print_pairs
from pounding_sweep.records.reader import floats

if TYPE_CHECKING:
    import xarray as xr

#: Units of drifts in m, and of shears in kN.
_UNITS: dict[str, dict[str, float]] = read_data("records.toml")["pushover"]
#: A unit at the end of a heading, or alone.
_STATED = re.compile(r"(?:^|[(\[,_/])\s*([A-Za-z]+)\s*[)\]]?$")
#: Share of the yield strength at which stiffness is measured, and to which the falling branch is drawn.
_SECANT = 0.6
#: Share of what follows the cap: the mean shear beyond it is a residual if the third line has come down to it by then.
_SEEN = 0.9


@dataclass(frozen=True)
class PushoverFit:
    """What a storey of a `Building` takes, and the curve (m, kN) with what was fitted to it."""

    stiffness: float  # kN/m
    yield_strength: float  # kN
    hardening: float
    hysteresis: dict[str, Any]  # law, cap_drift (m), post_cap and residual, as far as the curve shows them
    error: float  # root mean square of its shears, over the yield strength
    curve: xr.Dataset = field(repr=False)  # drift, shear; corner_drift, corner_shear


def backbone_from_pushover(
    path: FilePath,
    *,
    drift: str | None = None,
    shear: str | None = None,
    units: tuple[str, str] | None = None,
    law: str = "bilinear",
    target_drift: float | None = None,
) -> PushoverFit:
    """Fit yield, hardening, cap, post-cap slope and residual to the pushover curve of a storey, and print them.

    Up to the largest shear two lines are fitted: the first through the curve at 60 % of the yield strength, the second
    to the largest shear, with the area under the curve. From there a third line goes through the point at which the
    curve has fallen to 60 % of the yield strength, or half way if it falls less, down to the shear that the last tenth
    of the falling branch has on average, a residual if the line gets there before.

    Parameters
    ----------
    path : path
        Text file of columns between commas, semicolons, tabs or blanks, with headings.
    drift, shear : str, optional
        Headings of both columns, or parts of them; by default the first in a unit of length and of force.
    units : tuple of str, optional
        Units of drift and shear; by default those in headings, such as ``Drift (mm)``, or in a line below them.
    law : str, optional
        Storey law of the result.
    target_drift : float, optional
        Drift (m) at which the second line ends if it is less than that of the largest shear.

    Returns
    -------
    PushoverFit
        ``stiffness``, ``yield_strength``, ``hardening`` and ``hysteresis`` are what a `Building` takes of a storey;
        `figures.pushover` draws ``curve``.

    Raises
    ------
    InputError
        The file can't be read, or columns or their units are not known, or shears do not rise from zero.

    References
    ----------
    ASCE/SEI 41-17, Seismic evaluation and retrofit of existing buildings, 7.4.3.2.4.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> curve = [[0, 0], [5, 200], [30, 250], [50, 150], [60, 100], [90, 100]]
    >>> with tempfile.NamedTemporaryFile(suffix=".csv") as file:
    ...     np.savetxt(file.name, curve, delimiter=",", header="drift (mm),shear (kN)", comments="")
    ...     fit = backbone_from_pushover(file.name)
    stiffness       40000 kN/m, at 60 % of the yield strength
    yield strength  200 kN at 5 mm
    hardening       0.05
    cap             250 kN at 30 mm
    post-cap slope  -0.125 of the stiffness
    residual        0.5 of the yield strength
    error           0.0% of the yield strength, at most 0.0%; area +0.0%
    >>> fit.hysteresis
    {'law': 'bilinear', 'cap_drift': 0.03, 'post_cap': -0.125, 'residual': 0.5}
    """
    import xarray as xr

    d, v = _read_curve(path, (drift, shear), units)
    limit = np.inf if target_drift is None else target_drift
    largest = float(np.max(v, where=d <= limit, initial=0.0))
    if largest <= 0.0:
        raise InputError(f"target_drift is {limit:g} m; it must be beyond the first drift, {d[1]:g} m")
    peak = int(np.flatnonzero((v >= largest * (1.0 - 1e-9)) & (d <= limit))[-1])
    cap, top, end, least = (float(x) for x in (d[peak], v[peak], d[-1], v[peak:].min()))

    def secant(strength: float) -> float:
        at = int(np.argmax(v >= _SECANT * strength))
        return _SECANT * strength / float(np.interp(_SECANT * strength, v[at - 1 : at + 1], d[at - 1 : at + 1]))

    def excess(strength: float) -> float:
        return float(0.5 * (strength * cap + top * (cap - strength / secant(strength))) - under[peak])

    under = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(d))]).tolist()
    low = 1e-3 * top
    strength = brentq(excess, low, top, xtol=1e-14 * top) if excess(low) < 0.0 < excess(top) else top
    k = secant(strength)
    ends = [(0.0, 0.0), (strength / k, strength), (cap, top)]
    hardening = round((top - strength) / (k * cap - strength), 9) if top > strength else 0.0
    rows = [("stiffness", f"{k:.5g} kN/m, at 60 % of the yield strength")]
    rows += [("yield strength", f"{strength:.4g} kN at {1e3 * strength / k:.4g} mm"), ("hardening", f"{hardening:.3g}")]
    hysteresis: dict[str, Any] = {"law": law}
    if least < (1.0 - 1e-3) * top:
        to = _SECANT * strength if least < _SECANT * strength else 0.5 * (top + least)
        at = peak + int(np.argmax(v[peak:] <= to))
        slope = (top - to) / (float(np.interp(-to, -v[at - 1 : at + 1], d[at - 1 : at + 1])) - cap)
        rest = float(np.interp(np.linspace(end - (1.0 - _SEEN) * (end - cap), end, 101), d, v).mean())
        falls = (top - rest) / slope
        hysteresis |= {"cap_drift": cap, "post_cap": -slope / k}
        rows.append(("cap", f"{top:.4g} kN at {1e3 * cap:.4g} mm"))
        rows.append(("post-cap slope", f"{-slope / k:.3g} of the stiffness"))
        if falls < _SEEN * (end - cap):
            hysteresis["residual"] = max(round(rest / strength, 12), 0.0)
            rows.append(("residual", f"{hysteresis['residual']:.3g} of the yield strength"))
            ends += [(cap + falls, rest), (end, rest)]
        else:
            ends.append((end, top - slope * (end - cap)))
    even, corners = np.linspace(0.0, ends[-1][0], 1001), np.transpose(ends)
    misses = np.interp(even, *corners) - np.interp(even, d, v)
    whole = np.interp(even[-1], d, under)
    area = (np.trapezoid(corners[1], corners[0]) - whole) / whole
    error, worst = float(np.sqrt(np.mean(misses**2))) / strength, np.abs(misses).max() / strength
    text = f"{error:.1%} of the yield strength, at most {worst:.1%}; area {round(area, 9) + 0.0:+.1%}"
    print_pairs([*rows, ("error", text)])
    drifts, shears = {"units": "m"}, {"units": "kN"}
    columns = {"drift": ("point", d, drifts), "shear": ("point", v, shears)}
    columns |= {"corner_drift": ("corner", corners[0], drifts), "corner_shear": ("corner", corners[1], shears)}
    return PushoverFit(k, strength, hardening, hysteresis, error, xr.Dataset(columns))


def _read_curve(path: FilePath, names: Any, units: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return drifts (m) from zero on, each beyond those before it, and shears (kN) of a file."""
    try:
        lines = expanded(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"pushover file {str(path)!r} could not be read: {error}") from None
    mark = next((mark for mark in "\t;," if any(mark in line for line in lines)), " ")
    rows = [
        row for row in csv.reader((line.strip(" ") for line in lines), delimiter=mark, skipinitialspace=True) if row
    ]
    numbers = [floats(" ".join(row).replace(",", ".")) for row in rows]
    first = next((i for i, row in enumerate(numbers) if row), len(rows))
    table = np.array([row for row in numbers if row and len(row) == len(rows[first])])
    headings, columns = [*zip(*(row for row in rows[:first] if len(row) == table.shape[-1]), strict=True)], []
    for number, (what, sizes) in enumerate(_UNITS.items()):
        words = [[match[1].lower() for cell in cells if (match := _STATED.search(cell))] for cells in headings]
        stated = [[word for word in own if word in sizes] for own in words]
        if names[number]:
            fits = [i for i, cells in enumerate(headings) if names[number].lower() in " ".join(cells).lower()]
        else:
            fits = [number] if units else [i for i, found in enumerate(stated) if found]
        unit = units[number].lower() if units else next((found[-1] for i in fits[:1] if (found := stated[i])), None)
        if not fits or unit not in sizes or len(table) < 3:
            raise InputError(
                f"{str(path)!r} has no column of {what} whose unit is known, its headings being "
                f"{', '.join(map(' '.join, headings)) or 'none'}; give {what}= and units=, such as ('mm', 'kN'); "
                f"valid for {what}: {', '.join(sizes)}"
            )
        columns.append(table[:, fits[0]] * sizes[unit])
    d, v = (x * np.sign(x[np.argmax(np.abs(x))]) for x in columns)
    rises = d > np.maximum.accumulate(np.concatenate([[0.0], d[:-1]]))
    if not (v[rises].max(initial=0.0) > 0.0 and np.isfinite([d, v]).all()):
        raise InputError(f"{str(path)!r}: shears do not rise with the drift from zero; check the columns")
    return np.concatenate([[0.0], d[rises]]), np.concatenate([[0.0], v[rises]])
