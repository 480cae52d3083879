"""Faults of a sweep: what pydantic finds and what our own checks raise, each with its place, in our words."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from pounding_sweep.base.errors import SHOWN_CHARACTERS, Fault, InputError, Place, PoundingSweepError, shown, unknown


class Faults:
    """Faults found so far, each with its place, such as ``("gaps", 3)``."""

    def __init__(self) -> None:
        self.found: list[Fault] = []

    def add(self, place: Place, text: str) -> None:
        """Note a fault."""
        self.found.append((place, text))

    def take(self, place: Place, error: Exception) -> None:
        """Note what an error says of a part of the sweep that stands at `place`."""
        if isinstance(error, ValidationError):
            found = [(each["loc"], _text(each)) for each in error.errors(include_url=False)]
        else:
            found = [(getattr(error, "place", ()), str(error))]
        self.found += [((*place, *inner), text) for inner, text in found]

    def attempt(self, place: Place, make: Callable[..., Any], *given: Any, **named: Any) -> Any:
        """Make something of what is given; None, with its faults noted, if that fails."""
        try:
            return make(*given, **named)
        except (ValidationError, PoundingSweepError) as error:
            self.take(place, error)
        except ArithmeticError as error:  # numbers so large or small that nothing can be computed from them
            self.add(place, f"holds numbers that are out of range ({error})")
        return None

    def refuse(self) -> None:
        """Raise all of them as one error of pydantic, if there are any."""
        if self.found:
            details: list[InitErrorDetails] = [
                {"type": PydanticCustomError("fault", "{text}", {"text": text}), "loc": place, "input": None}
                for place, text in self.found
            ]
            raise ValidationError.from_exception_data("sweep", details)


@contextmanager
def gathering() -> Iterator[Faults]:
    """Note faults in the block, and raise them at its end."""
    faults = Faults()
    yield faults
    faults.refuse()


def _text(error: ErrorDetails) -> str:
    """Return the text of a fault that is in our own words already."""
    context = error.get("ctx", {})
    return str(context.get("text", context.get("error", error["msg"])))


def spell(place: Place) -> str:
    """Write a place as text, ``"gaps[3]"``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{_brief(part)}" for part in place).lstrip(".")


def _brief(key: str) -> str:
    return key if len(key) <= SHOWN_CHARACTERS else f"{key[:SHOWN_CHARACTERS]}..."


class Table(BaseModel):
    """A table: its keys and their types. Other keys are faults."""

    model_config = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True, title="table")

    @model_validator(mode="wrap")
    @classmethod
    def _in_our_words(cls, given: Any, read: ModelWrapValidatorHandler[Any]) -> Any:
        if not isinstance(given, dict):
            msg = f"must be a table of {', '.join(cls.model_fields)}, not {shown(given)}"
            raise InputError(msg)
        with gathering() as faults:
            try:
                return read(given)
            except ValidationError as error:
                found = error.errors(include_url=False)
                for each in sorted(found, key=lambda each: each["type"] not in ("extra_forbidden", "invalid_key")):
                    said = each["type"] in ("fault", "value_error")
                    faults.found.append((each["loc"], _text(each)) if said else cls.worded(each))

    @classmethod
    def worded(cls, error: ErrorDetails) -> tuple[Place, str]:
        """Word a fault in keys and types that pydantic found."""
        key, *rest = error["loc"]
        place = (key, *(part for part in rest if isinstance(part, int)))
        if error["type"] in ("extra_forbidden", "invalid_key"):
            return place, unknown("key", key, cls.model_fields)
        what = cls.model_fields[str(key)].description or "a valid value"
        if error["type"] == "missing":
            return place, f"is missing; give {what}"
        return place, f"{shown(error['input'])} won't do{' in' if rest else '; it must be'} {what}"


def is_number(value: object) -> bool:
    """Whether `value` is a real number, no truth value and no text."""
    return isinstance(value, numbers.Real) and not is_flag(value)


def is_flag(value: object) -> bool:
    """Whether `value` is true or false."""
    return isinstance(value, (bool, np.bool_))


def listed(given: Any, single: tuple[type, ...] = ()) -> list[Any] | None:
    """Return one item or several as a list; None if `given` is neither."""
    if single and isinstance(given, single):
        return [given]
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (str, bytes, dict)) else None


def number(value: Any, what: str, check: Callable[..., object], *more: Any) -> float:
    """Convert and check a number; `more` is what the check gets beside it."""
    if not is_number(value):
        msg = f"{shown(value)} is not a number ({what})"
        raise InputError(msg)
    try:
        found = float(value) + 0.0  # -0.0 becomes 0.0
        check(found, *more)
    except OverflowError:
        msg = f"{what} is too large a number"
        raise InputError(msg) from None
    return found


def within(what: str, low: float, high: float) -> Callable[[float], None]:
    """Make a check that a number is finite and in a range."""

    def check(value: float) -> None:
        if not math.isfinite(value):
            msg = f"{what} is {shown(value)}; it must be a finite number"
            raise InputError(msg)
        if not low <= value <= high:
            msg = f"{what} is {shown(value)}; it must be in [{low:g}, {high:g}]"
            raise InputError(msg)

    return check
