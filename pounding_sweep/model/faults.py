"""Faults of what a user gave, each with its place: tables, dataclasses and numbers that pydantic checks."""

from __future__ import annotations

import functools
import inspect
import numbers
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from typing import Annotated, Any, Literal, TypeVar, dataclass_transform

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetPydanticSchema,
    Tag,
    TypeAdapter,
    ValidationError,
    model_validator,
    validate_call,
)
from pydantic.dataclasses import dataclass
from pydantic_core import ArgsKwargs, ErrorDetails, PydanticCustomError

from pounding_sweep.base.errors import (
    MAX_CHARACTERS,
    Fault,
    InputError,
    Place,
    PoundingSweepError,
    SceneError,
    repr_short,
    unknown,
)
from pounding_sweep.base.files import read_data


class Faults:
    """Faults found so far, each with its place, such as ``("gaps", 3)``; a `with` block raises them at its end."""

    def __init__(self) -> None:
        self.entries: list[Fault] = []

    def __enter__(self) -> Faults:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None and self.entries:
            raise ValidationError.from_exception_data(
                "sweep",
                [
                    {"type": PydanticCustomError("fault", "{text}", {"text": text}), "loc": place, "input": None}
                    for place, text in self.entries
                ],
            )

    def add(self, place: Place, text: str) -> None:
        """Note a fault."""
        self.entries.append((place, text))

    def attempt(self, place: Place, make: Callable[..., Any], *args: Any, **named: Any) -> Any:
        """Make something; None, with its faults noted at `place`, if that fails."""
        try:
            return make(*args, **named)
        except ValidationError as error:
            details = map(_in_words, error.errors(include_url=False))
            self.entries += [((*place, *inner), text) for inner, text in details]
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
    parts = (f"[{part}]" if isinstance(part, int) else f".{part[:MAX_CHARACTERS]}" for part in place)
    return "".join(parts).lstrip(".")


_CONFIG = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
_STRICT = ConfigDict(strict=True, frozen=True, **_CONFIG)
_PARAMETER = re.compile(r"^(\w[\w, ]*?)(?: : .*)?\n((?: {4}.*(?:\n|\Z))+)", re.MULTILINE)
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])


def meanings(taker: Any) -> dict[str, str]:
    """Return the first sentence that a docstring says of each parameter, or those of its bases."""
    return {
        name: re.split(r"[.;:] ", " ".join(text.split()))[0].rstrip(".")
        for item in reversed(getattr(taker, "__mro__", [taker]))
        for names, text in _PARAMETER.findall(
            (inspect.getdoc(item) or "").partition("\n----------\n")[2].partition("\n\n")[0]
        )
        for name in names.split(", ")
    }


def unknown_key(name: object, valid: Iterable[str]) -> str:
    """Say that a key is unknown; of what cannot be modelled, what to do instead."""
    for topic in read_data("unmodelled.toml").values():
        if re.match(topic["keys"], str(name).lower()):
            return (
                f"unknown key {repr_short(name)}: {topic['what']} cannot be modelled; {topic['instead']}; see the page "
                "'What cannot be modelled'"
            )
    return unknown("key", name, valid)


def worded(error: ErrorDetails, taker: Any, descriptions: Mapping[str, str | None]) -> Fault:
    """Word an error of pydantic on what `taker` takes: keys with descriptions, or with meanings in its docstring."""
    kind, (first, *rest) = error["type"], error["loc"] or ("",)
    if isinstance(first, int) and kind != "invalid_key":  # an argument by its position
        first = list(descriptions)[first]
    place = (first, *(part for part in rest if not str(part).startswith("|")))  # but for members of unions
    if kind in ("fault", "value_error"):
        inner, text = _in_words(error)
        return (*place, *inner[len(error["loc"]) :]) if error["loc"] else inner, text
    if kind in ("extra_forbidden", "invalid_key", "unexpected_keyword_argument"):
        return place, unknown_key(place[-1], descriptions)
    doc = descriptions.get(str(first))
    what = doc or meanings(taker).get(str(first), "a valid value")
    if kind.startswith("missing"):
        return place, f"is missing; give {what}"
    must = "it must be " if doc else re.sub("^[A-Z][a-z]+ should", "it must", error["msg"]) + ": "
    how = " in " if doc and len(place) > 1 else f"; {must}"
    return place, f"{repr_short(error['input'])} won't do{how}{what}{_per_cent(error)}"


def _per_cent(error: ErrorDetails) -> str:
    """Say what a number that may be in per cent is as a share; "" for other faults."""
    value, most = error["input"], (bounds := error.get("ctx", {})).get("lt", bounds.get("le"))
    return f"; {value / 100:g} for {value:g} %" if most == 1 and is_number(value) and 1 < value <= 100 else ""


@contextmanager
def _wording(taker: Any, descriptions: Mapping[str, str | None]) -> Iterator[None]:
    """Raise the faults that pydantic finds in our own words."""
    with Faults() as faults:
        try:
            yield
        except ValidationError as error:
            details = error.errors(include_url=False)
            faults.entries += dict.fromkeys(worded(detail, taker, descriptions) for detail in details)


def _check(cls: Any, raw: Any, read: Callable[[Any], Any]) -> Any:
    """Validate a table, or the arguments of a class; `FILE_KEYS` are keys that a file's reader replaces."""
    keys = {name: field.description for name, field in cls.__pydantic_fields__.items() if field.init is not False}
    if isinstance(raw, dict):
        keys |= dict.fromkeys(getattr(cls, "FILE_KEYS", ()))
    elif not isinstance(raw, (cls, ArgsKwargs)):
        name = cls.__name__.removesuffix("Table")
        raise InputError(f"must be a {name} or a table of {', '.join(keys)}, not {repr_short(raw)}")
    with _wording(cls, keys):
        return read(raw)


class Table(BaseModel):
    """A table: its keys and their types. Other keys are faults."""

    model_config = _STRICT
    _check = model_validator(mode="wrap")(classmethod(_check))  # type: ignore[arg-type]


def derived(*, init: Literal[False] = False) -> Any:
    """Make a field that follows from the others; `__post_init__` gives it by `set_fields`."""
    return field(default=None, init=init, repr=False, compare=False)


def set_fields(item: Any, **values: Any) -> None:
    """Give fields of a frozen dataclass their values."""
    for name, value in values.items():
        object.__setattr__(item, name, value)


@dataclass_transform(frozen_default=True, field_specifiers=(field, derived))
def checked(cls: type[T]) -> type[T]:
    """Make a frozen dataclass whose arguments pydantic checks, given in Python or as a table of a file."""
    cls._check = model_validator(mode="wrap")(classmethod(_check))  # type: ignore[attr-defined, arg-type]
    made: Any = dataclass(frozen=True, config=_CONFIG)(cls)
    made.__init__ = _raising(made.__init__, made, {}, getattr(cls, "ERROR", SceneError))
    return made


def checked_call(raised: type[InputError], function: F) -> F:
    """Have pydantic check the arguments of a function by their annotations."""
    keys = dict.fromkeys(inspect.signature(function).parameters)
    return _raising(validate_call(config=_CONFIG)(function), function, keys, raised)


def _raising(call: Any, taker: Any, keys: Mapping[str, None], raised: type[InputError]) -> Any:
    """Return a call whose faults are one error, of what has been given as name, pair or key."""

    @functools.wraps(call)
    def wrapper(*args: Any, **named: Any) -> Any:
        try:
            return call(*args, **named)
        except ValidationError as error:
            errors = [worded(detail, taker, keys) for detail in error.errors(include_url=False)]
            names = *(named.get(key) for key in ("name", "pair", "key")), *args
            name = next((name for name in names if isinstance(name, str)), None)
            owner = taker.__name__ if name is None else f"{taker.__name__} {repr_short(name)}"
            texts = [f"{owner}: {spell(place)}: {text}" if place else f"{owner}: {text}" for place, text in errors]
            raise raised("\n".join(texts)) from None

    return wrapper


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
Number = Annotated[float, BeforeValidator(_as_float), Field(strict=True)]
Flag = Annotated[
    bool, BeforeValidator(lambda value: bool(value) if isinstance(value, np.bool_) else value), Field(strict=True)
]

#: Numbers within bounds, and whole numbers.
Positive = Annotated[Number, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[Number, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[Number, Field(allow_inf_nan=False)]
Fraction = Annotated[Number, Field(ge=0.0, lt=1.0)]
Integer = Annotated[
    int, BeforeValidator(lambda value: int(value) if isinstance(value, np.integer) else value), Field(strict=True)
]


def _as_tuple(value: Any) -> tuple[Any, ...]:
    if not (isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim)):
        raise InputError(f"must be a list, not {repr_short(value)}")
    return tuple(value.tolist() if isinstance(value, np.ndarray) else value)


#: Before a sequence: lists and arrays are taken as tuples.
Listed = BeforeValidator(_as_tuple)


def as_mapping(value: Any) -> Any:
    """Return pairs of a key and a value, as JSON holds mappings, as a mapping."""
    try:
        return dict(value) if isinstance(value, list | tuple) else value
    except (TypeError, ValueError):  # no pairs
        return value


def schema(kind: Any) -> GetPydanticSchema:
    """Return the schema of a type, for what type checkers know as another one."""
    return GetPydanticSchema(lambda _, handler: handler(kind))


def one_or_several(one: Any, several: Any) -> GetPydanticSchema:
    """Return the schema of one thing, or of a list."""
    union = Annotated[one, Tag("|one")] | Annotated[several, Listed, Tag("|several")]
    tags = Discriminator(lambda value: "|several" if isinstance(value, (list, tuple, np.ndarray)) else "|one")
    return schema(Annotated[union, tags])


def called(function: Callable[..., T], table: Any, first: str = "", also: Collection[str] = (), **more: Any) -> T:
    """Call a function with a table of its arguments, checked by its annotations, and `more`.

    The table may name the `first` anew, and keys that the caller takes out are in `also`.
    """
    names = [name for name in inspect.signature(function).parameters if name not in more]
    keys = dict.fromkeys((*([first, *names[1:]] if first else names), *also))
    if not isinstance(table, dict):
        raise InputError(f"must be a table of {', '.join(keys)}, not {repr_short(table)}")
    if first:
        keys[first] = meanings(function).get(names[0])
    named = {key: value for key, value in table.items() if key != first} | more
    with _wording(function, keys):
        arguments = ArgsKwargs((table[first],) if first else (), named)
        return TypeAdapter(function, config=_STRICT).validate_python(arguments)  # type: ignore[arg-type]


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
        except ValidationError as error:
            hint = _per_cent(error.errors()[0])
            raise InputError(f"{repr_short(value)} won't do; it must be a {field.description}{hint}") from None

    return check


def one_of(what: str, valid: Collection[str]) -> AfterValidator:
    """Make a check that a value is one of several texts."""

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in valid:
            raise InputError(unknown(what, value, valid))
        return value

    return AfterValidator(check)


def listed(value: Any, single: tuple[type, ...] = ()) -> list[Any] | None:
    """Return one item or several as a list; None if `value` is neither."""
    if single and isinstance(value, single):
        return [value]
    one = isinstance(value, str | bytes | dict) or getattr(value, "ndim", 1) == 0
    return list(value) if isinstance(value, Iterable) and not one else None


def valid_part(model: type[Table], raw: Any, faults: Faults) -> dict[str, Any]:
    """Return the values of a table by key, defaults for those at fault; nothing of what is no table."""
    before = len(faults.entries)
    table = faults.attempt((), model.model_validate, raw)
    if table is not None or not isinstance(raw, dict):
        return dict(table or ())
    wrong = {place[0] for place, _ in faults.entries[before:]}
    valid = model.model_construct(**{name: value for name, value in raw.items() if name not in wrong})
    return {**dict.fromkeys(model.model_fields), **dict(valid)}
