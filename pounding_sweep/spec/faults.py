"""Faults of a sweep, each with its place, and the tables and numbers that pydantic checks, worded for a user."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Collection, Iterable
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from pounding_sweep.base.errors import SHOWN_CHARACTERS, Fault, InputError, Place, PoundingSweepError, shown, unknown


class Faults:
    """Faults found so far, each with its place, such as ``("gaps", 3)``; a `with` block raises them at its end."""

    def __init__(self) -> None:
        self.found: list[Fault] = []

    def __enter__(self) -> Faults:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None and self.found:
            text = [PydanticCustomError("fault", "{text}", {"text": text}) for _, text in self.found]
            details = zip(text, self.found, strict=True)
            raise ValidationError.from_exception_data(
                "sweep", [{"type": error, "loc": place, "input": None} for error, (place, _) in details]
            )

    def add(self, place: Place, text: str) -> None:
        """Note a fault."""
        self.found.append((place, text))

    def attempt(self, place: Place, make: Callable[..., Any], *args: Any, **named: Any) -> Any:
        """Make something; None, with its faults noted at `place`, if that fails."""
        try:
            return make(*args, **named)
        except ValidationError as error:
            worded = [_in_words(each) for each in error.errors(include_url=False)]
            self.found += [((*place, *inner), text) for inner, text in worded]
        except (PoundingSweepError, ValueError) as error:
            self.add((*place, *getattr(error, "place", ())), str(error))
        except ArithmeticError as error:  # numbers so large or small that nothing can be computed from them
            self.add(place, f"holds numbers that are out of range ({error})")
        return None


def _in_words(error: ErrorDetails) -> Fault:
    """Return a fault whose text is in our own words already."""
    context = error.get("ctx", {})
    cause = context.get("error")
    return (*error["loc"], *getattr(cause, "place", ())), str(context.get("text", cause or error["msg"]))


def spell(place: Place) -> str:
    """Write a place as text, ``"gaps[3]"``."""
    short = (
        part[:SHOWN_CHARACTERS] + "..." * (len(part) > SHOWN_CHARACTERS) if isinstance(part, str) else part
        for part in place
    )
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in short).lstrip(".")


class Table(BaseModel):
    """A table: its keys and their types. Other keys are faults."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, arbitrary_types_allowed=True, title="table")

    @model_validator(mode="wrap")
    @classmethod
    def _in_our_words(cls, given: Any, read: ModelWrapValidatorHandler[Any]) -> Any:
        if not isinstance(given, dict):
            raise InputError(
                f"must be a {cls.model_config['title']} of {', '.join(cls.model_fields)}, not {shown(given)}"
            )
        with Faults() as faults:
            try:
                return read(given)
            except ValidationError as error:
                faults.found += dict.fromkeys(cls._worded(each) for each in error.errors(include_url=False))

    @classmethod
    def _worded(cls, error: ErrorDetails) -> Fault:
        kind, place = error["type"], error["loc"]
        if kind in ("fault", "value_error"):
            return _in_words(error)
        key, *rest = place
        place = (key, *(part for part in rest if isinstance(part, int)))
        if kind in ("extra_forbidden", "invalid_key"):
            return place, unknown("key", key, cls.model_fields)
        what = cls.model_fields[str(key)].description or "a valid value"
        if kind == "missing":
            return place, f"is missing; give {what}"
        return place, f"{shown(error['input'])} won't do{' in' if rest else '; it must be'} {what}"


def is_number(value: object) -> bool:
    """Whether `value` is a real number, no truth value and no text."""
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_))


def _as_float(value: Any) -> Any:
    if type(value) is float:
        return value + 0.0
    try:
        return float(value) + 0.0 if is_number(value) else value  # -0.0 becomes 0.0
    except OverflowError:  # a whole number beyond all others
        return value


#: A number of any type, and a truth value.
Number = Annotated[float, BeforeValidator(_as_float)]
Flag = Annotated[bool, BeforeValidator(lambda value: bool(value) if isinstance(value, np.bool_) else value)]

_BOUNDS = {"gt": "above {:g}", "ge": "at least {:g}", "lt": "below {:g}", "le": "at most {:g}"}


def key(description: str, default: Any = ...) -> Any:
    """Return the field of a key: what it takes, in words, and its default; it is needed without one."""
    return Field(default, description=description)


def number(what: str, default: Any = ..., **bounds: float) -> Any:
    """Return the field of a finite number within bounds; `what` names it and its unit."""
    words = " and ".join(_BOUNDS[name].format(bound) for name, bound in bounds.items()) or "a finite number"
    limits: dict[str, Any] = {"allow_inf_nan": False, **bounds}
    return Field(default, description=f"{what}, {words}", **limits)


def number_check(what: str, **bounds: float) -> Callable[[Any], float]:
    """Make a check of one number, as `number` is in a table; it returns it as a float."""
    field = number(what, **bounds)
    validate = TypeAdapter(Annotated[Number, field], config=ConfigDict(strict=True)).validate_python

    def check(value: Any) -> float:
        try:
            return validate(value)
        except ValidationError:
            raise InputError(f"{shown(value)} won't do; it must be a {field.description}") from None

    return check


def one_of(what: str, valid: Collection[str]) -> AfterValidator:
    """Make a check that a value is one of several texts."""

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in valid:
            raise InputError(unknown(what, value, valid))
        return value

    return AfterValidator(check)


def listed(given: Any, single: tuple[type, ...] = ()) -> list[Any] | None:
    """Return one item or several as a list; None if `given` is neither."""
    if single and isinstance(given, single):
        return [given]
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (str, bytes, dict)) else None


def valid_part(model: type[Table], given: Any, faults: Faults) -> dict[str, Any]:
    """Return the values of a table by key, defaults for those at fault; nothing of what is no table."""
    before = len(faults.found)
    table = faults.attempt((), model.model_validate, given)
    if table is not None or not isinstance(given, dict):
        return dict(table or ())
    wrong = {place[0] for place, _ in faults.found[before:]}
    defaults = {name: None if field.is_required() else field.default for name, field in model.model_fields.items()}
    return defaults | {name: value for name, value in given.items() if name not in wrong}
