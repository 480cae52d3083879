"""Faults with their places, and the checks of single numbers and axes."""

from __future__ import annotations

import itertools
import math
import numbers
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.base.errors import SHOWN_CHARACTERS, InputError, PoundingSweepError, shown, unknown
from pounding_sweep.model.scene import check_gap
from pounding_sweep.spec.axes import Range
from pounding_sweep.spec.spec import MAX_AXIS

#: Stands for a part that was found at fault already: nothing more is said about it.
FAILED: Any = object()

Place = tuple[str | int, ...]

#: More faults than this on one axis are only counted.
_MOST_FAULTS = 20


@dataclass
class Faults:
    """Faults found so far, each with its place, such as ``("gaps", 3)``."""

    found: list[tuple[Place, str]] = field(default_factory=list)

    def add(self, place: Place, text: str) -> None:
        """Note a fault."""
        self.found.append((place, text))

    def named(self) -> list[tuple[str, str]]:
        """Return the faults with their places as text, ``"gaps[3]"``."""
        return [(spell(place), text) for place, text in self.found]


def spell(place: Place) -> str:
    """Write a place as text.

    Examples
    --------
    >>> spell(("scene", "row", 1, "masses", 0))
    'scene.row[1].masses[0]'
    """
    return "".join(f"[{part}]" if isinstance(part, int) else f".{_brief(part)}" for part in place).lstrip(".")


def _brief(key: str) -> str:
    return key if len(key) <= SHOWN_CHARACTERS else f"{key[:SHOWN_CHARACTERS]}..."


def is_number(value: object) -> bool:
    """Whether `value` is a real number, no truth value and no text."""
    return isinstance(value, numbers.Real) and not is_flag(value)


def is_flag(value: object) -> bool:
    """Whether `value` is true or false."""
    return isinstance(value, (bool, np.bool_))


def has_failed(items: Iterable[Any]) -> bool:
    """Whether any part was found at fault already."""
    return any(item is FAILED for item in items)


def listed(given: Any, single: tuple[type, ...]) -> list[Any] | None:
    """Return one item or several as a list; None if `given` is neither."""
    if isinstance(given, single):
        return [given]
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (bytes, dict)) else None


def gap_check(value: float) -> None:
    """Raise `SceneError` unless `value` (m) will do as a gap."""
    check_gap(value, "gap")


def positive(what: str) -> Callable[[float], None]:
    """Make a check that a number is finite and above 0."""

    def check(value: float) -> None:
        if not (math.isfinite(value) and value > 0):
            msg = f"{what} is {shown(value)}; it must be a positive number"
            raise InputError(msg)

    return check


def finite(what: str) -> Callable[[float], None]:
    """Make a check that a number is finite."""

    def check(value: float) -> None:
        if not math.isfinite(value):
            msg = f"{what} is {shown(value)}; it must be a finite number"
            raise InputError(msg)

    return check


def one_number(faults: Faults, place: Place, value: Any, check: Callable[[float], None], what: str) -> float | None:
    """Convert and check one number; None, with a fault noted, if it won't do."""
    if not is_number(value):
        faults.add(place, f"{shown(value)} is not a number ({what})")
        return None
    try:
        number = float(value) + 0.0  # -0.0 becomes 0.0
        check(number)
    except OverflowError:
        faults.add(place, f"{what} is too large a number")
        return None
    except PoundingSweepError as error:
        faults.add(place, str(error))
        return None
    return number


def _range(faults: Faults, place: Place, given: Range) -> tuple[float, ...] | None:
    before = len(faults.found)
    start = one_number(faults, (*place, "start"), given.start, finite("start"), "first value")
    stop = one_number(faults, (*place, "stop"), given.stop, finite("stop"), "last value")
    if not isinstance(given.count, numbers.Integral) or is_flag(given.count):
        faults.add((*place, "count"), f"must be a whole number, not {shown(given.count)}")
    elif given.count < 1:
        faults.add((*place, "count"), f"count = {given.count}: a sweep of zero scenarios; give at least 1")
    elif given.count == 1 and start != stop:
        faults.add(
            (*place, "count"), f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2"
        )
    if given.spacing not in ("linear", "log"):
        faults.add((*place, "spacing"), unknown("spacing", given.spacing, ["linear", "log"]))
    elif given.spacing == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        faults.add((*place, "spacing"), f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}")
    return given.values() if len(faults.found) == before else None


def _size(given: Any) -> tuple[Any, int]:
    """Return values whose length is known, and the length, without expanding a range."""
    if isinstance(given, Range):
        whole = isinstance(given.count, numbers.Integral)
        return given, max(0, int(given.count)) if whole else 0
    try:
        return given, len(given)
    except OverflowError:  # len() has a limit, range() has none
        return given, sys.maxsize
    except TypeError:  # a generator, perhaps an endless one
        taken = list(itertools.islice(given, MAX_AXIS + 1))
        return taken, len(taken)


def axis_values(
    faults: Faults, sizes: dict[str, int], place: Place, given: Any, check: Callable[[float], None], *, what: str
) -> tuple[float, ...] | None:
    """Convert and check the values of one axis; those at fault are noted and left out.

    `sizes` gets the number of values, before anything of that size is made.
    """
    if given is None or given is FAILED:
        return None
    name = spell(place)
    if hasattr(given, "__array__"):
        given = np.asarray(given).tolist()
    if is_number(given):
        given = [given]
    if isinstance(given, (str, bytes, dict)) or not isinstance(given, (Iterable, Range)):
        faults.add(place, f"must be a number or a list of numbers ({what}), not {shown(given)}")
        return None
    given, sizes[name] = _size(given)
    if sizes[name] > MAX_AXIS:
        faults.add(place, f"{sizes[name]} values are too many; give at most {MAX_AXIS}")
        return None
    values = _range(faults, place, given) if isinstance(given, Range) else tuple(given)
    if values is None:
        return None
    if not values:
        faults.add(place, "is empty: a sweep of zero scenarios; give at least one value or leave it out")
    seen: dict[float, int] = {}
    wrong = Faults()
    for index, value in enumerate(values):
        here = place if isinstance(given, Range) else (*place, index)
        number = one_number(wrong, here, value, check, what)
        if number is not None and number in seen:
            wrong.add(here, f"{number!r} repeats {name}[{seen[number]}]; the values of an axis must differ")
        elif number is not None:
            seen[number] = index
    faults.found += wrong.found[:_MOST_FAULTS]
    if len(wrong.found) > _MOST_FAULTS:
        faults.add(place, f"{len(wrong.found) - _MOST_FAULTS} more values are at fault")
    return tuple(seen)
