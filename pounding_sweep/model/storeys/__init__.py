"""Storey laws: each module here is one, its `LAW`. Models, kernels, results and documentation read the registry."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from importlib import import_module
from operator import or_
from pkgutil import iter_modules
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, GetPydanticSchema, Tag

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.storeys.base import DriftGauge, Elastic, Numbers, Sampled, SignGauge, StoreyLaw

#: Every storey law by its name, and the one of storeys that yield where no other is given.
STOREY_LAWS: dict[str, StoreyLaw] = {
    module.name: import_module(f"{__name__}.{module.name}").LAW
    for module in iter_modules(__path__)
    if module.name != "base"
}
DEFAULT = STOREY_LAWS["bilinear"]


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


def _tag_of(value: Any) -> str:
    return f"|{value['law'] if isinstance(value, Mapping) else value.law}"


_MEMBERS: Any = reduce(or_, (Annotated[law.Parameters, Tag(f"|{name}")] for name, law in STOREY_LAWS.items()))
_UNION = Annotated[_MEMBERS, Discriminator(_tag_of)]
#: Parameters of any law: a table with its name.
Hysteresis = Annotated[Any, BeforeValidator(_check_law), GetPydanticSchema(lambda _, handler: handler(_UNION))]

__all__ = [
    "DEFAULT",
    "STOREY_LAWS",
    "DriftGauge",
    "Elastic",
    "Hysteresis",
    "Numbers",
    "Sampled",
    "SignGauge",
    "StoreyLaw",
]
