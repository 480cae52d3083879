"""Rubber bumpers: a contact law of their own, their thickness, and where they are squeezed flat."""

from __future__ import annotations

import math

from pounding_sweep.base.errors import LawError, shown
from pounding_sweep.model.laws import Law


def rubber_bumper(
    thickness: float,
    *,
    stiffness: float | None = None,
    key: str = "rubber_bumper",
    exponent: float = 2.65,
    limit: float = 0.8,
    stop: float = 1.0,
) -> Law:
    """Return the contact law of rubber bumpers between the floors of neighbours.

    A bumper fills part of the gap, so that floors meet its thickness earlier. On approach
    F = k d^n, d its compression, as far as the share `limit` of its thickness, and from there
    on a straight line; on rebound this force times (1 + D v / v0), by which it is lost what a
    collision takes. D is such that two free masses rebound at exactly the coefficient of
    restitution, whatever the speed and the thickness.

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
            msg = f"rubber bumper {key!r}: {what} is {shown(value)}; it must be {valid}"
            raise LawError(msg)
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
