"""Listed cases of several cubes: which of them are the same scenario, and what each is called."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.merge_checks import REMEDY, damaged

if TYPE_CHECKING:
    import xarray as xr

#: Cubes by the name of their file
Parts = Mapping[str, "xr.Dataset"]
#: Dimension of listed scenarios.
CASE = "case"
#: Coordinates that tell listed cases apart, as far as a cube has them. Restitution and stiffness count where the
#: law ignores them, too: they are what the case was listed with, and selected by.
_KNOWN_BY = (
    *("law", "record", "scale", "restitution", "contact_stiffness", "pair_gap"),
    *("period_factor", "mass_factor", "damping_ratio"),
)


def lists_cases(cube: xr.Dataset) -> bool:
    """Whether the scenarios of a cube are listed ones."""
    return CASE in cube.dims


def check_cases(parts: Parts, sweeps: Sequence[Mapping[str, Any]]) -> None:
    """Raise `InputError` where the cases of cubes are not those of their sweeps, or ran in different kernels."""
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        for key in ("law", "record"):
            if key not in cube.coords or cube[key].values.tolist() != [case[key] for case in sweep["cases"] or ()]:
                msg = f"{name!r} has other cases than its sweep; {REMEDY}"
                raise InputError(msg)
        for key in _KNOWN_BY:
            if key in cube.coords and cube[key].dims[:1] != (CASE,):
                raise damaged(name, f"coordinate {key!r} is not along {CASE!r} first")
        labels = cube[CASE].values
        if labels.dtype.kind == "f" and not np.isfinite(labels).all():
            raise damaged(name, "a case has no label")
    (first, base), *others = parts.items()
    for name, cube in others:
        if ("period_factor" in cube.coords) != ("period_factor" in base.coords):
            varied, plain = (first, name) if "period_factor" in base.coords else (name, first)
            msg = (
                f"{varied!r} varies building properties and {plain!r} doesn't, so they ran in different kernels: add a "
                "case with such a property to the sweep of the second and run it again"
            )
            raise InputError(msg)
        for key in _KNOWN_BY:
            if (key in cube.coords) != (key in base.coords):
                has, lacks = (first, name) if key in base.coords else (name, first)
                msg = f"{lacks!r} has no coordinate {key!r}, {has!r} has; give the cubes as they were made"
                raise InputError(msg)


@dataclass(frozen=True)
class Cases:
    """Cases of several cubes.

    Attributes
    ----------
    parts : dict of str to xarray.Dataset
        The cubes, each scenario once: a list may name one in two spellings.
    keys : list of list of bytes
        What each case of each part is known by: equal for the same scenario, under the same label if it has one.
    labels : list
        Labels of all cases, each once, in the order given; numbers from 1 where no cube has labels of its own.
    described : list of dict
        What the sweeps say of them.
    """

    parts: dict[str, xr.Dataset]
    keys: list[list[bytes]]
    labels: list[Any]
    described: list[dict[str, Any]]


def cases_together(parts: Parts, sweeps: Sequence[Mapping[str, Any]]) -> Cases:
    """Find out which cases of cubes are the same.

    Parameters
    ----------
    parts : mapping of str to xarray.Dataset
        Cubes of one study, by the name of their file.
    sweeps : sequence of dict
        What they say of their sweeps.

    Raises
    ------
    InputError
        The same label stands for two scenarios, or some labels are text and others numbers.

    Notes
    -----
    Values that differ by rounding only make two cases. Values of an axis of two parts are hardly so close by
    intention, those of a long list may be.
    """
    labelled = any(cube[CASE].values.tolist() != list(range(1, cube.sizes[CASE] + 1)) for cube in parts.values())
    texts: dict[str, int] = {}
    found, keys = {}, []
    described: dict[bytes, dict[str, Any]] = {}
    for (file, cube), sweep in zip(parts.items(), sweeps, strict=True):
        first: dict[bytes, int] = {}
        for position, key in enumerate(_keys(cube, texts, labelled=labelled)):
            first.setdefault(key, position)
        for key, position in first.items():
            described.setdefault(key, sweep["cases"][position])
        found[file] = cube if len(first) == cube.sizes[CASE] else cube.isel(case=list(first.values()))
        keys.append(list(first))
    labels = _labels(found, keys) if labelled else list(range(1, len(described) + 1))
    return Cases(found, keys, labels, list(described.values()))


def _keys(cube: xr.Dataset, texts: dict[str, int], *, labelled: bool) -> list[bytes]:
    """Return what each case is known by; `texts` are the numbers of the texts met so far, in any cube."""
    columns = []
    for name in (*([CASE] if labelled else []), *_KNOWN_BY):
        if name not in cube.coords:
            continue
        values = cube[name].values
        if values.dtype.kind not in "iuf":
            values = np.array([texts.setdefault(str(value), len(texts)) for value in values.tolist()])
        columns.append(values.reshape(len(values), -1) + 0.0)  # -0.0 is 0.0
    table = np.hstack(columns)
    table[np.isnan(table)] = np.nan  # which may have many forms
    return [row.tobytes() for row in table]


def _labels(parts: Parts, keys: Sequence[Sequence[bytes]]) -> list[Any]:
    """Return the labels of all cases, each once, in the order given."""
    found: dict[Any, tuple[bytes, str, int]] = {}
    for (file, cube), mine in zip(parts.items(), keys, strict=True):
        for position, (label, key) in enumerate(zip(cube[CASE].values.tolist(), mine, strict=True)):
            known, other, place = found.setdefault(label, (key, file, position))
            if known != key:
                one, two = case_name(parts[other].coords, place), case_name(cube.coords, position)
                msg = f"case {label!r} is {one} in {other!r}, and {two} in {file!r}; give one of them another label"
                raise InputError(msg)
    kinds = sorted({type(label).__name__ for label in found})
    if len(kinds) > 1:
        msg = f"some cases have labels of type {kinds[0]}, others of type {kinds[1]}; give all of them text"
        raise InputError(msg)
    return list(found)


def telling(coordinates: Mapping[Any, xr.Variable]) -> list[str]:
    """Return those coordinates of listed cases in which they differ."""
    found = []
    for name in (name for name in _KNOWN_BY if name in coordinates):
        values = coordinates[name].values
        if values.dtype.kind == "f":
            values = np.nan_to_num(values, nan=-np.inf)
        if (values != values[:1]).any():
            found.append(name)
    return found


def case_name(coordinates: Mapping[Any, Any], position: int, names: Sequence[str] = _KNOWN_BY) -> str:
    """Say which scenario a listed case is, by those of its coordinates that have a value.

    Examples
    --------
    >>> import xarray as xr
    >>> cases = {"law": xr.Variable("case", ["linear"]), "pair_gap": xr.Variable(("case", "pair"), [[0.01, 0.02]])}
    >>> case_name(cases, 0)
    'law=linear pair_gap=0.01/0.02'
    """
    told = []
    for name in (name for name in names if name in coordinates):
        values = list(dict.fromkeys(np.ravel(coordinates[name].values[position]).tolist()))
        if not any(isinstance(value, float) and math.isnan(value) for value in values):
            told.append(f"{name}={'/'.join(map(str, values))}")
    return " ".join(told)
