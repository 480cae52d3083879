"""Storey laws: each module here with a `LAW` is one. Models, kernels, results and documentation read the registry."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from importlib import import_module
from operator import or_
from pkgutil import iter_modules
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Tag

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.faults import schema
from pounding_sweep.model.storeys.base import (
    FAILED,
    DriftGauge,
    Elastic,
    Numbers,
    Sampled,
    SignGauge,
    StoreyLaw,
    list_lengths,
    of_storey,
)

#: Every storey law by its name, and the one of storeys that yield where no other is given.
STOREY_LAWS: dict[str, StoreyLaw] = {
    name: module.LAW
    for name in sorted(module.name for module in iter_modules(__path__))
    if hasattr(module := import_module(f"{__name__}.{name}"), "LAW")
}
DEFAULT = STOREY_LAWS["bilinear"]


def law_of(name: str, compiled: tuple[float, ...]) -> StoreyLaw:
    """Return the law that springs of a name and compiled parameters follow."""
    return STOREY_LAWS[name].variant(compiled)


def _check_law(value: Any) -> Any:
    """Check that parameters name a law of the registry."""
    if isinstance(value, Mapping):
        if "law" not in value:
            raise InputError(f"has no law; give the name of a storey law, one of {', '.join(STOREY_LAWS)}")
        if not isinstance(value["law"], str) or value["law"] not in STOREY_LAWS:
            raise InputError(unknown("storey law", value["law"], STOREY_LAWS))
    elif not isinstance(value, tuple(law.Parameters for law in STOREY_LAWS.values())):
        raise InputError(f"must be a table with a law, one of {', '.join(STOREY_LAWS)}, and its parameters")
    return value


_MEMBERS: Any = reduce(or_, (Annotated[law.Parameters, Tag(f"|{name}")] for name, law in STOREY_LAWS.items()))
_TAGS = Discriminator(lambda value: f"|{value['law'] if isinstance(value, Mapping) else value.law}")
#: Parameters of any law: a table with its name.
Hysteresis = Annotated[Any, BeforeValidator(_check_law), schema(Annotated[_MEMBERS, _TAGS])]

__all__ = [
    "DEFAULT",
    "FAILED",
    "STOREY_LAWS",
    "DriftGauge",
    "Elastic",
    "Hysteresis",
    "Numbers",
    "Sampled",
    "SignGauge",
    "StoreyLaw",
    "law_of",
    "list_lengths",
    "of_storey",
]
