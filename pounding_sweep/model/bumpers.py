"""Bumpers: contacts with a law of their own; of rubber their law, their thickness, where they are squeezed flat."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.base.errors import LawError, SceneError, shown, unknown
from pounding_sweep.model.laws import LAWS, Law, law_of
from pounding_sweep.model.quantity import quantity

#: Name of the law of `rubber_bumper`, which the thickness completes.
RUBBER = "rubber_bumper"


def rubber_bumper(
    thickness: float,
    *,
    stiffness: float | None = None,
    key: str = RUBBER,
    exponent: float = 2.65,
    limit: float = 0.8,
    stop: float = 1.0,
) -> Law:
    """Return the contact law of rubber bumpers between the floors of neighbours.

    A bumper fills part of the gap, so that floors meet its thickness earlier. On approach F = k d^n, d its compression,
    as far as the share `limit` of its thickness, and from there on a straight line; on rebound this force times (1 + D
    v / v0), by which it is lost what a collision takes. D is such that two free masses rebound at exactly the
    coefficient of restitution, whatever the speed and the thickness.

    Parameters
    ----------
    thickness : float
        Thickness (m) of the rubber, of both floors together.
    stiffness : float, optional
        Reference value of k (kN/m**exponent), which stiffness factors scale: for a force F at
        a compression d in a test, F / d**exponent.
    key : str
        Name in sweeps and cubes.
    exponent : float
        Power n of the compression.
    limit : float
        Compression, in parts of the thickness, from which the force grows along a straight line, in (0, 1].
    stop : float
        Slope of that line over the slope of the rubber where it begins, 1 or more.

    Returns
    -------
    Law
        A law that sweeps and `simulate` take in the place of a key of the registry.

    Raises
    ------
    LawError
        A number is out of its range.

    References
    ----------
    Polycarpou, Komodromos & Polycarpou (2013), Earthquake Eng. Struct. Dyn. 42(1), 81-100: the
    publication was not at hand, its abstract only. The form of the force and the exponent are from memory,
    and the damping is not the published one; see the page on theory.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> pad = ps.rubber_bumper(0.05, stiffness=500 / 0.04**2.65)  # 500 kN at 40 mm
    >>> pad.thickness, pad.stiffness_unit, pad.relation
    (0.05, 'kN m-2.65', 'rebound')
    """
    for what, value, valid, holds in (
        ("thickness", thickness, "a positive number (m)", lambda x: 0.0 < x < math.inf),
        ("limit", limit, "in (0, 1]", lambda x: 0.0 < x <= 1.0),
        ("stop", stop, "a number >= 1", lambda x: 1.0 <= x < math.inf),
        ("exponent", exponent, "in [1, 10]", lambda x: 1.0 <= x <= 10.0),
    ):
        if not (isinstance(value, int | float) and not isinstance(value, bool) and holds(value)):
            raise LawError(f"rubber bumper {key!r}: {what} is {shown(value)}; it must be {valid}")
    flat = limit * thickness
    rubber, beyond = f"(d - max(d - {flat!r}, 0.0))**{exponent!r}", f"max(d - {flat!r}, 0.0)"
    slope = stop * exponent * flat ** (exponent - 1.0)
    shape = f"({rubber} + {slope!r}*{beyond})"
    return Law(
        key=key,
        title=f"Rubber bumper of {1e3 * thickness:g} mm",
        exponent=exponent,
        elastic=f"k*{shape}",
        damper=f"c*{shape}",
        damping="elastic",
        rebound_only=True,
        thickness=float(thickness),
        reference_stiffness=stiffness,
        formula=(
            f"F = E on approach, max(0, E (1 + D v / v0)) on rebound; E = k d^{exponent:g} as far as {flat:g} m, "
            f"from there on a straight line of {stop:g} times its slope"
        ),
        reference="after Polycarpou, Komodromos & Polycarpou (2013), Earthquake Eng. Struct. Dyn. 42(1), 81-100",
    )


@dataclass(frozen=True)
class Bumper:
    """What stands between floors of two neighbours, or before a wall, and gives their contacts a law of their own.

    Those contacts keep this law, its stiffness and restitution in every scenario; all others of the row take what
    the sweep gives. Under the law "none", which stands for no pounding, bumpers do not act either.

    Parameters
    ----------
    pair : str
        Name of the pair of neighbours, ``"left-right"``.
    law : str or Law
        Contact law: a key of the registry, ``"rubber_bumper"`` for that of `rubber_bumper`, or a law of one's own. As
        an attribute: the law itself.
    stiffness : float, optional
        Contact stiffness (kN/m**exponent); the law's reference where not given.
    restitution : float, optional
        Coefficient of restitution; needed by a law that takes one.
    thickness : float, optional
        Thickness (m), by which floors meet earlier; the law's where not given.
    storeys : sequence of int
        Storeys that have it, as results number them; all at which floors of the pair meet where not given.

    Raises
    ------
    SceneError
        The law is unknown or has no force, or a number is missing or out of its range.

    Examples
    --------
    >>> pad = Bumper("a-b", "rubber_bumper", stiffness=500 / 0.04**2.65, restitution=0.5, thickness=0.05)
    >>> pad.law.title, pad.law.stiffness_unit
    ('Rubber bumper of 50 mm', 'kN m-2.65')
    """

    pair: str
    law: Any
    stiffness: float = None  # type: ignore[assignment]
    restitution: float | None = None
    thickness: float = None  # type: ignore[assignment]
    storeys: Sequence[int] = ()

    def __post_init__(self) -> None:
        owner = f"bumper of pair {shown(self.pair)}"
        for name, unit, positive in (("thickness", "m", False), ("stiffness", "kN/m**exponent", True)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, quantity(value, f"{owner}: {name}", unit, positive=positive))
        law = _law(self.law, self.thickness, owner)
        object.__setattr__(self, "law", law)
        if self.thickness is None:
            object.__setattr__(self, "thickness", law.thickness)
        elif law.thickness and self.thickness != law.thickness:
            raise SceneError(
                f"{owner}: thickness is {self.thickness:g} m beside the {law.thickness:g} m of its law; leave it out"
            )
        if self.stiffness is None:
            object.__setattr__(self, "stiffness", law.reference_stiffness)
        if self.stiffness is None:
            raise SceneError(f"{owner}: law {law.key!r} needs a stiffness ({law.stiffness_unit})")
        if self.restitution is not None and not law.takes_restitution:
            raise SceneError(f"{owner}: law {law.key!r} takes no restitution; leave it out")
        self.check_restitution("published")
        storeys = tuple(self.storeys) if isinstance(self.storeys, Iterable) else (self.storeys,)
        if not all(isinstance(s, numbers.Integral) and not isinstance(s, bool) for s in storeys):
            raise SceneError(f"{owner}: storeys are {shown(self.storeys)}; give a list of whole numbers")
        object.__setattr__(self, "storeys", tuple(map(int, storeys)))

    def check_restitution(self, basis: str) -> None:
        """Raise `SceneError` unless the restitution is valid for the law on that basis."""
        e = self.restitution
        try:
            if e is not None and (isinstance(e, bool) or not isinstance(e, numbers.Real)):
                raise LawError(f"restitution {shown(e)} is no number; give {self.law.validity}")
            self.law.check_restitution(None if e is None else float(e), basis)
        except LawError as error:
            raise SceneError(f"bumper of pair {shown(self.pair)}: {error}") from None

    def damping_coefficient(self, mass: np.ndarray, basis: str) -> np.ndarray:
        """Coefficient of the damper of contacts of some effective masses (t), see `Law.damping_coefficient`."""
        return self.law.damping_coefficient(self._e, self.stiffness, mass, basis)

    def quickening(self, basis: str) -> float:
        """See `Law.quickening`."""
        return float(self.law.quickening(self._e, basis))

    @property
    def _e(self) -> float:
        return 1.0 if self.restitution is None else self.restitution

    @property
    def data(self) -> dict[str, Any]:
        """The bumper as JSON holds it, arguments of its own."""
        law: Law = self.law
        return {
            **vars(self),
            "law": law.key if LAWS.get(law.key) is law else law.described,
            "storeys": list(self.storeys),
        }


def _law(given: Any, thickness: float | None, owner: str) -> Law:
    """Return the law of a bumper that is given as such, as JSON holds it, or by its key."""
    if given == RUBBER:
        if not thickness:
            raise SceneError(f"{owner}: law {RUBBER!r} needs the thickness of the rubber (m), a positive number")
        return rubber_bumper(thickness)
    try:
        law = law_of(given) if isinstance(given, Mapping) else given
    except (LawError, TypeError) as error:
        raise SceneError(f"{owner}: {error}") from None
    if isinstance(law, str) and law in LAWS:
        law = LAWS[law]
    if not isinstance(law, Law):
        raise SceneError(f"{owner}: {unknown('contact law', given, LAWS)}, or {RUBBER!r}")
    if law.exponent is None:
        raise SceneError(f"{owner}: law {law.key!r} has no force that a bumper could have; give another law")
    if LAWS.get(law.key) is not law and not (law.number is None or isinstance(law.number, str)):
        raise SceneError(
            f"{owner}: law {law.key!r} gives its damping number as a function; give it as text, a formula of e"
        )
    return law
