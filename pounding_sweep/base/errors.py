"""Errors that a user can mend: messages name the value, what is valid and the remedy; the command line prints them."""

from __future__ import annotations

import difflib
import functools
import inspect
import os
import reprlib
from collections.abc import Callable, Collection, Hashable, Iterable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

#: Where something stands in what a user gave, such as ``("masses", 1)``; and a fault, its place and what it is.
Place = tuple[str | int, ...]
Fault = tuple[Place, str]


class PoundingSweepError(Exception):
    """Base of all errors raised on purpose by this package."""


class InputError(PoundingSweepError, ValueError):
    """A value given by the user is not valid."""


class SceneError(InputError):
    """A building, wall, gap or row of buildings is not valid; ``place`` is where in it, where that is known."""

    def __init__(self, message: str, place: Place = ()) -> None:
        super().__init__(message)
        self.place = place


class LawError(InputError):
    """A contact law, its stiffness or its restitution is not valid."""


class RecordError(InputError):
    """A ground-motion record can't be read, found or used."""


class MissingRecordError(RecordError):
    """A ground-motion record is not at hand; ``record`` is the name it would have had."""

    def __init__(self, message: str, record: str) -> None:
        super().__init__(message)
        self.record = record


class SweepError(InputError):
    """A sweep description is not valid; ``problems`` lists every fault found."""

    def __init__(self, message: str, problems: Iterable[str] = ()) -> None:
        super().__init__(message)
        self.problems = tuple(problems)


class StabilityError(InputError):
    """The asked step is beyond the stability limit of the scheme."""


class OutputError(PoundingSweepError, OSError):
    """The output can't be written or read back."""


class WriteError(OutputError):
    """A run can't go on writing: the disk is full or failed, or its folder is gone; what is finished is kept."""


class RunError(PoundingSweepError):
    """A run came to nothing: none of its chunks has a result."""


class ClusterError(PoundingSweepError):
    """The dask cluster of a run can't be reached, is gone, or has no workers that can do it."""


class UnlikelyWarning(UserWarning):
    """A value that can be computed with, but that no real building has; most likely a slip of units."""


#: Characters of a value that a message shows, and names that `unknown` lists.
MAX_CHARACTERS, MAX_NAMES = 200, 50

_BRIEF = reprlib.Repr()
_BRIEF.maxlevel = 3
_BRIEF.maxlist = _BRIEF.maxtuple = _BRIEF.maxdict = 20
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = MAX_CHARACTERS


def repr_short(value: object) -> str:
    """Return `repr` of a value from anywhere in a few words, however long or deep it is."""
    try:
        text = _BRIEF.repr(value)
    except (ValueError, RecursionError):  # a whole number of thousands of digits, or depth in an object of its own
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= MAX_CHARACTERS else f"{text[: MAX_CHARACTERS - 3]}..."


def unknown(kind: str, value: object, valid: Iterable[str]) -> str:
    """Say that `value` is no known `kind`, suggest the closest, list all, or the first ones of very many."""
    names, word = sorted(valid), value if isinstance(value, str) else repr_short(value)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.6) if len(word) <= MAX_CHARACTERS else []
    hint = f"; did you mean {close[0]!r}? Valid: " if close else "; valid: "
    more = f", and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return f"unknown {kind} {repr_short(value)}{hint}{', '.join(names[:MAX_NAMES])}{more}"


#: Classes by annotation, for arguments that are of one kind.
_KINDS = {"FilePath": "str or PathLike", "Record": "Record", "Scene": "Scene"}


def checked_arguments(function: F) -> F:
    """Make a public function that refuses arguments it does not take, and those of a wrong kind, by `InputError`."""
    signature, owner = inspect.signature(function), function.__qualname__.removesuffix(".__init__")
    names = [name for name in signature.parameters if name != "self"]

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        open_ended = any(item.kind is item.VAR_KEYWORD for item in signature.parameters.values())
        if wrong := [name for name in kwargs if name not in names and not open_ended]:
            raise InputError(f"{owner}: {unknown('argument', wrong[0], names)}")
        try:
            arguments = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise InputError(f"{owner}: {error}; it takes {', '.join(names)}") from None
        for name, value in arguments.items():
            kind, default = str(signature.parameters[name].annotation), signature.parameters[name].default
            must = _KINDS.get(kind.removesuffix(" | None"))
            classes = [cls.__name__ for cls in type(value).__mro__] + ["PathLike"] * isinstance(value, os.PathLike)
            if must and value is not default and not {*must.split(" or ")} & {*classes}:
                raise InputError(f"{owner}: {name} is {repr_short(value)}; it must be a {must}")
        return function(*args, **kwargs)

    return cast("F", call)


def check_choice(kind: str, value: Any, valid: Collection[Any], error: type[InputError] = InputError) -> None:
    """Raise an error with the text of `unknown` unless `value` is among the `valid` values."""
    if not isinstance(value, Hashable) or value not in valid:
        raise error(unknown(kind, value, map(str, valid)))
