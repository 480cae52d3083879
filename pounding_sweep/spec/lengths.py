"""How large a sweep is, before any of its axes is expanded."""

from __future__ import annotations

import math
import numbers
import sys
from collections.abc import Iterable, Mapping, Sized
from typing import Any

from pounding_sweep.spec.axes import FACTOR_KINDS, Range
from pounding_sweep.spec.faults import FAILED, spell
from pounding_sweep.spec.spec import MAX_AXIS, MAX_SCENARIOS

#: Axes of at most so many values are checked value by value even in a sweep that is too large.
CHECKED_AXIS = 10_000


def _length(given: Any) -> int | None:
    """Return the number of values of an axis; None where only expanding it would tell."""
    if isinstance(given, Range):
        return int(given.count) if isinstance(given.count, numbers.Integral) and given.count > 0 else None
    if not isinstance(given, Sized) or isinstance(given, (str, bytes, Mapping)):
        return None
    try:
        return len(given)
    except (OverflowError, TypeError):  # range() has no limit, len() has; an array of no dimension has no length
        return sys.maxsize if isinstance(given, range) else None


def long_axes_left_out(given: dict[str, Any], axes: Iterable[str], sizes: dict[str, int]) -> dict[str, Any]:
    """Put `FAILED` for the long axes of a sweep that is too large, so that none of them is expanded.

    Parameters
    ----------
    given : dict
        Arguments of `build_spec` by name.
    axes : iterable of str
        Those that are axes; factors by building are looked at too.
    sizes : dict
        Numbers of records, laws and so on; gets those of the axes left out.

    Returns
    -------
    dict
        The arguments, long axes replaced where the sweep has more than `MAX_SCENARIOS` scenarios. Axes beyond
        `MAX_AXIS` stay: they are refused for themselves, unexpanded.
    """
    items: dict[tuple[str, ...], Any] = {(name,): given[name] for name in axes}
    for name in FACTOR_KINDS:
        if isinstance(given[name], Mapping):
            items |= {(name, building): values for building, values in given[name].items()}
    lengths = {place: found for place, values in items.items() if (found := _length(values)) is not None}
    if math.prod(lengths.values()) * math.prod(sizes.values()) <= MAX_SCENARIOS:
        return given
    kept = {name: dict(values) if isinstance(values, Mapping) else values for name, values in given.items()}
    for place, count in lengths.items():
        if CHECKED_AXIS < count <= MAX_AXIS:
            sizes[spell(place)] = count
            name, *building = place
            if building:
                kept[name][building[0]] = FAILED
            else:
                kept[name] = FAILED
    return kept
