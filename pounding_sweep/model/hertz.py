"""Contact stiffness of two spheres, for laws whose force goes with d^1.5."""

from __future__ import annotations

import math

from pounding_sweep.base.errors import LawError


def hertz_stiffness(
    mass_1: float | None = None,
    mass_2: float | None = None,
    *,
    young_modulus: float = 25.0e6,
    poisson_ratio: float = 0.2,
    density: float = 2.5,
    radii: tuple[float, float] | None = None,
) -> float:
    """Hertz contact stiffness of two spheres (kN/m^1.5).

    Equations 9 to 11 of Mate, Bakre & Jaiswal (2015), corrected: the radius is the *cube* root of the sphere's volume
    relation, and the material term has 1 - nu**2 (Goldsmith 1960).

    Parameters
    ----------
    mass_1, mass_2 : float, optional
        Colliding masses (t), from which radii follow with `density`.
    young_modulus : float
        E (kN/m2) of both bodies.
    poisson_ratio : float
        nu, 0 <= nu < 0.5.
    density : float
        t/m3.
    radii : tuple of float, optional
        The two radii (m), given instead of masses.

    Returns
    -------
    float
        4 / (3 pi (h1 + h2)) sqrt(R1 R2 / (R1 + R2)), h = (1 - nu**2) / (pi E).

    Raises
    ------
    LawError
        A value is not positive, or neither masses nor radii are given.

    Examples
    --------
    >>> round(hertz_stiffness(133.956, 136.286) / 1e7, 3)
    1.88
    """
    if radii is None:
        if mass_1 is None or mass_2 is None:
            raise LawError("hertz_stiffness needs two masses (t) or radii=(R1, R2) (m)")
        positive = {"mass_1": mass_1, "mass_2": mass_2, "density": density}
    else:
        positive = {"radii[0]": radii[0], "radii[1]": radii[1]}
    for name, value in {**positive, "young_modulus": young_modulus}.items():
        if not (math.isfinite(value) and value > 0):
            raise LawError(f"hertz_stiffness: {name} = {value!r} must be a positive number")
    if not 0 <= poisson_ratio < 0.5:
        raise LawError(f"hertz_stiffness: poisson_ratio = {poisson_ratio!r} must be in [0, 0.5)")
    if radii is None:
        assert mass_1 is not None
        assert mass_2 is not None
        r1, r2 = (((3.0 * m) / (4.0 * math.pi * density)) ** (1.0 / 3.0) for m in (mass_1, mass_2))
    else:
        r1, r2 = radii
    h = (1.0 - poisson_ratio**2) / (math.pi * young_modulus)
    return 4.0 / (3.0 * math.pi * 2.0 * h) * math.sqrt(r1 * r2 / (r1 + r2))
