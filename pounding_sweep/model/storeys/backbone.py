"""What storeys that degrade have in common: a backbone with a cap, a residual and an end, and cyclic deterioration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from pounding_sweep.base.errors import SceneError
from pounding_sweep.model.faults import Finite, GetPydanticSchema, Positive, checked, one_or_several
from pounding_sweep.model.storeys.base import Numbers, Shares, StoreyLaw

#: A number of all storeys, or one per storey.
OfStoreys = Annotated[float | Sequence[float], one_or_several(Finite, Sequence[Finite])]
PositiveOfStoreys = Annotated[float | Sequence[float], one_or_several(Positive, Sequence[Positive])]


@checked
class Directions:
    """A number of each direction, of all storeys or one per storey.

    Parameters
    ----------
    positive, negative : float or sequence of float
        That of positive and of negative drifts, both with the sign of the one for both directions.
    """

    positive: OfStoreys
    negative: OfStoreys


def _union(handler: Any) -> Any:
    tags = Discriminator(lambda value: "|both" if isinstance(value, (dict, Directions)) else "|one")
    return handler(Annotated[Annotated[Directions, Tag("|both")] | Annotated[OfStoreys, Tag("|one")], tags])


#: The same, or a table of both directions.
OfDirections = Annotated[Any, GetPydanticSchema(lambda _, handler: _union(handler))]


@checked
class Deterioration:
    """Reference drifts of cyclic deterioration; a mode that has none does not deteriorate.

    A mode has lost everything once a spring has taken its strength times the reference drift as energy.

    Parameters
    ----------
    strength : float or sequence of float
        Reference drift (m) of the yield strength and the hardening.
    post_cap : float or sequence of float
        That of the post-cap branch.
    unloading : float or sequence of float
        That of the unloading stiffness.
    reloading : float or sequence of float
        That of the drift that reloading goes to; `bilinear` has none.
    """

    strength: PositiveOfStoreys | None = None
    post_cap: PositiveOfStoreys | None = None
    unloading: PositiveOfStoreys | None = None
    reloading: PositiveOfStoreys | None = None


def both(value: Any) -> tuple[Any, Any]:
    """Return a number of the negative and the positive direction."""
    return (value.negative, value.positive) if isinstance(value, Directions) else (value, value)


#: By field: whether a value is allowed, and what is.
_ALLOWED = {
    "cap_drift": (lambda x: x > 0.0, "above 0 m"),
    "post_cap": (lambda x: x < 0.0, "below 0"),
    "residual": (lambda x: 0.0 <= x < 1.0, "at least 0 and below 1"),
    "ultimate_drift": (lambda x: x > 0.0, "above 0 m"),
}


@checked
class Backbone(Shares):
    """Backbone beyond yield: a cap, a falling branch, a residual, and an end."""

    cap_drift: OfDirections | None = None
    post_cap: OfDirections = -0.1
    residual: OfDirections = 0.0
    ultimate_drift: OfDirections | None = None
    deterioration: Deterioration | None = None

    def __post_init__(self) -> None:
        for name, (is_allowed, words) in _ALLOWED.items():
            for value in both(getattr(self, name)):
                for x in value if isinstance(value, tuple) else () if value is None else (value,):
                    if not is_allowed(x):
                        raise SceneError(f"is {x:g}; it must be {words}", (name,))


class BackboneLaw(StoreyLaw):
    """A law with such a backbone."""

    def ultimate_drifts(self, parameters: Backbone, numbers: Numbers) -> tuple[Any, Any]:
        """Return those of the backbone."""
        if parameters.ultimate_drift is None:
            return super().ultimate_drifts(parameters, numbers)
        negative, positive = both(parameters.ultimate_drift)
        return negative * numbers.capacity, positive * numbers.capacity
