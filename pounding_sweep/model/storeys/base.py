"""What a storey law is: a value that says how the shear of a storey follows from its drift.

Models read its parameters, kernels its branches and events, results its energies. A law is written once, of `spring`:
one element of a storey, whose attributes are its rows of the state and its constants, numbers of lanes or arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from pounding_sweep.model.faults import Number, checked

#: Phase of a spring that has no strength any more, and never will.
FAILED = 900.0


@checked
class Shares:
    """What parameters of any law hold.

    Parameters
    ----------
    stiffness_share, strength_share : float
        Shares of the storey's stiffness and strength, where several elements share a storey.
    """

    stiffness_share: Annotated[Number, Field(gt=0.0, le=1.0)] = field(default=1.0, kw_only=True, repr=False)
    strength_share: Annotated[Number, Field(gt=0.0, le=1.0)] = field(default=1.0, kw_only=True, repr=False)

    def with_factors(self, capacity: float, deterioration: float) -> Shares:
        """Return the same, with factors on the drifts at which strength is lost and on those of deterioration."""
        return self


def with_values(parameters: Any, change: Callable[[str, Any], Any], within: str = "") -> Any:
    """Return parameters in which each value is what `change` makes of its name and itself, in tables of them too."""
    changed = {}
    for item in (item for item in fields(parameters) if item.init):
        name, value = f"{within}{item.name}", getattr(parameters, item.name)
        new = with_values(value, change, f"{name}.") if is_dataclass(value) else change(name, value)
        if new is not value:
            changed[item.name] = new
    return replace(parameters, **changed) if changed else parameters


def of_storey(parameters: Any, storey: int) -> Any:
    """Return the parameters of one storey, counted from 0: of each list its value."""
    return with_values(parameters, lambda _, x: x[storey] if isinstance(x, tuple) else x)


def list_lengths(parameters: Any) -> dict[str, int]:
    """Return the lengths of the lists that parameters hold, by their names."""
    lengths: dict[str, int] = {}

    def note(name: str, x: Any) -> Any:
        if isinstance(x, tuple):
            lengths[name] = len(x)
        return x

    with_values(parameters, note)
    return lengths


class Numbers(NamedTuple):
    """Numbers of a spring, of some variants of its building."""

    stiffness: Any  # elastic, lateral: with P-Delta less what the weights take (kN/m)
    hardening: Any  # stiffness after first yield over that
    yield_drift: Any  # drift of first yield (m)
    geometric: Any = 0.0  # what the weights take of its stiffness (kN/m)
    capacity: Any = 1.0  # factor on drifts at which it loses strength
    deterioration: Any = 1.0  # factor on the reference drifts by which it deteriorates


class Elastic(ABC):
    """What springs of kernels and of results have in common."""

    stiffness: Any  # elastic (kN/m)
    hardening: Any

    @property
    def hardened(self) -> tuple[Any, Any]:
        """Stiffness after first yield, and what that is less than the elastic one."""
        return self.hardening * self.stiffness, (1.0 - self.hardening) * self.stiffness


class Sampled(Elastic):
    """A spring of a result: its constants and rows as arrays."""

    def __init__(self, stiffness: Any, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values, stiffness=stiffness)


@dataclass(frozen=True)
class DriftGauge:
    """What ends a branch of a storey by its drift, and the phase that follows: it leaves a range, or turns back."""

    ranged: Any  # lanes in which there is a range
    low: Any  # its bounds (m)
    high: Any
    below: Any  # phases beyond them
    above: Any
    middle: Any  # what its bounds are about, and their distance to it (m): these are rounded
    reach: Any
    way: Any  # sign that the drift's rate has on this branch, 0 where it may turn
    turned: Any  # phase after it has turned


@dataclass(frozen=True)
class SignGauge:
    """A quantity that changes its sign, where the flow of an internal variable has a kink."""

    row: str  # its coefficients, where steps are series
    start: Any  # its values at the ends of a sub-step
    end: Any
    sign: Any  # that of the quantity before its change
    kink: float  # number of the kink, from 1
    #: its rates at both ends, times the sub-step; None of the drift's rate
    slopes: Callable[[Any], tuple[Any, Any]] | None = None


class StoreyLaw(ABC):
    """One law, the `LAW` of its module."""

    name: ClassVar[str]  # in sweep files, and of its module
    Parameters: ClassVar[type]  # what ``hysteresis`` takes beside ``law``
    #: whether its shear is a straight line of the drift between events: else its plastic drift, the row ``slip``, flows
    #: all along, by methods that `docs/kernels.md` lists
    straight: ClassVar[bool] = True
    #: whether its first branch has the storey's own stiffness, in whose modes flight is exact
    flies: ClassVar[bool] = True
    #: what kernels know of each spring, and rows of its state that steps leave to the next
    constants: ClassVar[tuple[str, ...]] = ("hardening", "yield_drift")
    rows: ClassVar[tuple[str, ...]] = ("phase", "slip")
    #: rows that a sub-step moves, which is undone where it is tried again
    moving: ClassVar[tuple[str, ...]] = ()
    softens: ClassVar[bool] = False  # its shear may fall with the drift
    has_tangent: ClassVar[bool] = True  # its tangent stiffness is one number while a storey yields
    can_fail: ClassVar[bool] = False  # whether it may lose all strength, its row ``phase`` being `FAILED` from then on
    #: whether a drift and the energy put in bound what it loses
    bounds_drifts: ClassVar[bool] = True

    # parameters ------------------------------------------------------------------------------------------------------

    def values(self, parameters: Any, numbers: Numbers) -> dict[str, Any]:
        """Return its `constants`."""
        return {"hardening": numbers.hardening, "yield_drift": numbers.yield_drift}

    def compiled(self, parameters: Any) -> tuple[float, ...]:
        """Return the parameters that decide a kernel's code."""
        return ()

    def variant(self, compiled: tuple[float, ...]) -> StoreyLaw:
        """Return what springs of these parameters follow: a law with rows and constants of its own, if they need it."""
        return self

    def ultimate_drifts(self, parameters: Any, numbers: Numbers) -> tuple[Any, Any]:
        """Return the sizes of the drifts (m) to the negative and the positive side at which its strength is gone."""
        return np.inf, np.inf

    def is_polynomial(self, compiled: tuple[float, ...]) -> bool:
        """Whether steps may be series."""
        return True

    # branches --------------------------------------------------------------------------------------------------------

    def begin(self, spring: Any, lanes: Any) -> None:  # noqa: B027
        """Put the first state of a spring whose rows are zero, in some lanes."""

    @abstractmethod
    def line(self, spring: Any) -> tuple[Any, Any]:
        """Return tangent (kN/m) and constant (kN) of the shear in the present branch."""

    @abstractmethod
    def gauges(self, spring: Any) -> Sequence[DriftGauge | SignGauge]:
        """Return what ends the present branch in the sub-step just taken: read wherever events are looked for."""

    @abstractmethod
    def switch(self, spring: Any, lanes: Any) -> None:
        """Enter the phase, or pass the kink, that the row ``then`` names, in some lanes."""

    @abstractmethod
    def follow(self, spring: Any) -> None:
        """Let internal variables follow the motion to the present state, and ``travel`` what is lost."""

    def strength_left(self, spring: Any) -> Any:
        """Return its strength over that at first, the lesser of both directions."""
        return spring.group.full(1.0)

    # energies and rest -----------------------------------------------------------------------------------------------

    @abstractmethod
    def stored(self, spring: Any, d: Any) -> Any:
        """Energy (kN m) that an unloading from the drift d gives back."""

    def loss(self, numbers: Numbers) -> Any:
        """Energy (kN m) per unit of ``travel``."""
        return (1.0 - numbers.hardening) * numbers.stiffness * numbers.yield_drift

    def residual(self, spring: Any) -> Any:
        """Drift (m) under no shear; NaN where there is none, or it is not known."""
        return np.full(np.shape(spring.slip), np.nan)
