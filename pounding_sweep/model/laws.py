"""Contact laws: what a law is, the registry in ``data/laws.toml``, laws of a user's own, and their damping.

While the penetration ``d`` (m) of two floors is positive, they press each other by F = E(d) + B(d) v (kN), ``v`` the
rate of ``d`` (m/s). E and B are text, compiled into the kernels, in ``d``, its root ``r``, the contact stiffness ``k``
and the damping coefficient ``c``, which follows from the restitution ``e`` by one dimensionless number per law:

    c = 2 * number * sqrt(k m)     (``viscous``)
    c = number * k / v0            (``elastic``: the damper is a share of E)
    c = number                     (``jump``: no force in an impact, velocities jump, v -> -c v)
    c = number                     (``yield``: the share of the energy that is lost)

with the effective mass m = m1 m2 / (m1 + m2) (t) and the approach velocity v0 (m/s) at the located touch. A law that
yields has memory: a spring beside another one that slips, F = K2 d + q, q' = (K1 - K2) v between 0 and a yield force,
which like K1 and K2 follow at the touch from k, v0 and m. Its expressions are those of its present straight line.
"""

from __future__ import annotations

import hashlib
import json
import math
import runpy
import traceback
from dataclasses import field, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from pounding_sweep.base.errors import LawError, repr_short, unknown
from pounding_sweep.base.files import expanded, read_data
from pounding_sweep.model import faults
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.faults import Flag, Number, Positive, checked_call, derived, one_of, set_fields
from pounding_sweep.model.rebound import RELATIONS, YIELD_SHARE, check_basis

#: Slowest approach velocity (m/s) that a law divides by; floors whose velocities jump and would be slower come to rest.
RESTING_SPEED = 1.0e-3
#: Damping number of a law of a user's own that none was published for: the one of the realised restitution.
SOLVED = "solved"


@faults.checked
class Law:
    """One contact law: expressions, parameters, validity and source.

    A law of one's own needs ``key`` and ``exponent``; with damping ``damper`` and ``damping`` too.

    Attributes
    ----------
    key : str
        Name in sweeps, cubes and on the command line.
    exponent : float or None
        Power of the penetration in E, as it begins; the contact stiffness is in kN/m**exponent. None: no force.
    title, model, formula, reference : str
        What the field calls it, its number in Mate, Bakre & Jaiswal (2015), the whole law as text, and its source.
    elastic, elastic_slope : str
        E(d) (kN) and dE/dd (kN/m) in the variables of this module; k d**exponent, and the derivative of E.
    damper, damper_slope : str
        B(d) (kN s/m) and dB/dd; empty for a law without damping.
    damper_exponent : float
        Power of the penetration in B, as it begins; follows from `damper`.
    damping : {"none", "viscous", "elastic", "jump", "yield"}
        How the damping number becomes the coefficient ``c``.
    number, number_text : str or None
        Damping number (dimensionless), a formula of e such as ``"1.5*(1 - e)"``, and as text with its usual symbol;
        ``"solved"``, as without any: the number with which two free masses rebound at exactly e.
    relation : str
        Key of `pounding_sweep.model.rebound.RELATIONS`: what restitution the damping really gives.
    relation_factor : float
        Factor that turns the damping number into the one of the relation.
    approach_only, rebound_only : bool
        The damper acts only while v > 0, or only while v < 0.
    tension : bool
        The force may pull while d > 0; otherwise F = max(0, E + B v).
    zero_restitution : bool
        e = 0 is valid.
    reference_stiffness : float, optional
        Contact stiffness (kN/m**exponent) that stiffness factors scale, where the scene has none for that exponent.
    thickness : float
        Thickness (m) of what stands in each gap, such as a bumper: floors meet at the gap less this.
    source : str
        Where a law of a user's own was read, FILE:NAME. No part of what the law is.

    Raises
    ------
    LawError
        A formula holds what it may not, or does not agree with the rest.

    Examples
    --------
    >>> mine = Law(
    ...     key="mine", exponent=1.25, damper="c*d**1.25", damping="elastic", number="1.5*(1 - e)", reference="-"
    ... )
    >>> mine.relation, mine.elastic_slope, float(realised_restitution(mine, 0.6).round(3))
    ('both_phases', '1.25 * max(d, 0.0) ** 0.25 * k', 0.712)
    """

    key: Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9_]*$")]
    exponent: Annotated[Number, Field(ge=1.0, le=10.0)] | None
    title: str = ""
    model: str = "-"
    formula: str = ""
    reference: str = "-"
    elastic: str = ""
    elastic_slope: str = ""
    damper: str = ""
    damper_slope: str = ""
    damper_exponent: Number = 0.0
    damping: Annotated[str, one_of("damping", ("none", "viscous", "elastic", "jump", "yield"))] = "none"
    number: str | None = None
    number_text: str = ""
    relation: Annotated[str, one_of("relation", ("", *RELATIONS))] | None = None
    relation_factor: Number = 1.0
    approach_only: Flag = False
    rebound_only: Flag = False
    tension: Flag = False
    zero_restitution: Flag = False
    reference_stiffness: Positive | None = None
    thickness: faults.NotNegative = 0.0
    source: str = field(default="", compare=False)
    ERROR: ClassVar = LawError

    #: whether floors that meet act on each other, whether velocities jump and floors rest on each other without
    #: penetration, and whether the force depends on how deep this contact has been before
    has_contact: bool = derived()
    impulsive: bool = derived()
    yields: bool = derived()
    takes_restitution: bool = derived()
    stiffness_unit: str = derived()  # "" for a law without contact
    validity: str = derived()  # valid coefficients of restitution, as text

    def __post_init__(self) -> None:
        set_fields(self, **_completed(self))
        jumps, takes, n = self.damping == "jump", self.number is not None, self.exponent
        contact = n is not None or jumps
        valid = "0 <= e <= 1" if self.zero_restitution else "0 < e <= 1"
        set_fields(
            self,
            has_contact=contact,
            impulsive=jumps,
            yields=self.damping == "yield",
            takes_restitution=takes,
            stiffness_unit="" if n is None else "kN m-1" if n == 1 else f"kN m-{n:g}",
            validity=valid if takes else "takes none (e = 1)" if contact else "takes none",
        )

    @property
    def described(self) -> dict[str, Any]:
        """The law as JSON holds it; arguments of its own."""
        return {item.name: getattr(self, item.name) for item in fields(self) if item.compare}

    @property
    def sha256(self) -> str:
        """SHA-256 (hex) of all that the law is."""
        return hashlib.sha256(json.dumps(self.described, sort_keys=True).encode()).hexdigest()

    @property
    def is_power(self) -> bool:
        """Whether E is a power of the penetration all along."""
        if self.exponent is None or self.yields:
            return True
        return _is_constant(_tried(self.elastic, _DEPTHS) / _DEPTHS**self.exponent)

    @property
    def grows(self) -> bool:
        """Whether the force grows with the penetration at any rate of approach: E does of every law."""
        return not self.damper or bool((np.diff(_tried(self.damper, _DEPTHS)) >= 0.0).all())

    def check_restitution(self, e: float | None, basis: str = "published") -> None:
        """Raise `LawError` unless `e` is valid for this law on that basis ("published" or "realised")."""
        check_basis(basis)
        if not self.takes_restitution:
            return
        if e is None:
            raise LawError(f"law {self.key!r} needs a coefficient of restitution; give {self.validity}")
        if not (0.0 <= e <= 1.0 and (e or self.zero_restitution)):
            raise LawError(f"restitution {e!r} is outside the validity of law {self.key!r}; give {self.validity}")
        if basis == "realised":
            _check_realisable(self, e)

    def damping_coefficient(self, e: Any, k: Any, m: Any, basis: str = "published") -> np.ndarray:
        """Coefficient ``c`` of the damper (``damping`` "elastic": times v0), of stiffness (kN/m**n) and mass (t)."""
        shape = np.ones(np.broadcast_shapes(np.shape(k), np.shape(m)))
        if self.number is None:
            return 0.0 * shape
        factor = k
        if self.damping == "viscous":
            factor = 2.0 * np.sqrt(np.multiply(k, m, dtype=float))
        elif self.impulsive or self.yields:
            factor = 1.0
        return damping_number(self, e, basis) * factor * shape

    def quickening(self, e: Any, basis: str = "published") -> np.ndarray:
        """Factor >= 1 by which damping makes the fastest part of a contact shorter than that of an elastic one."""
        # an overdamped dashpot has a rate of 2 zeta times the frequency; a damper that is D times the elastic force at
        # the touch stiffens it to 1 + D, and so does a contact that yields before it does
        if self.number is None or self.impulsive:
            return np.ones(np.shape(e))
        number = damping_number(self, e, basis) * (0.4 / YIELD_SHARE if self.yields else 1.0)
        return np.maximum(1.0, 2.0 * number) if self.damping == "viscous" else np.sqrt(1.0 + number)


def duration_of(exponent: float) -> tuple[float, float]:
    """Factor and power of (m / k) by which an elastic contact lasts, at an approach of 1 m/s."""
    power = 1.0 / (exponent + 1.0)
    factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + power) / math.gamma(0.5 + power)
    return factor * (0.5 * (exponent + 1.0)) ** power, power


#: Penetrations (m), the first two to tell the power with which a force begins, and restitutions that are tried.
_DEPTHS, _NOMINAL = np.array([1e-12, 2e-12, *np.geomspace(1e-8, 0.5, 40)]), np.linspace(0.05, 1.0, 20)
#: Agreement of formulas, relative.
_RTOL = 1e-9


def _completed(law: Law) -> dict[str, Any]:
    """Check a law, and return what it leaves out."""
    title = law.title or law.key.replace("_", " ").capitalize()
    n = law.exponent
    if n is None or law.damping in ("jump", "yield"):
        zero = {name: getattr(law, name) or "0.0" for name in ("elastic", "elastic_slope", "damper_slope")}
        return {"title": title, **zero, "damper_exponent": 0.0, "relation": law.relation or ""}
    elastic = law.elastic or ("k*d" if n == 1.0 else f"k*d**{n:g}")
    if bool(law.damper) != (law.damping != "none") or (law.number is not None and not law.damper):
        raise LawError(
            "damper and damping belong together: give both (damping 'viscous' or 'elastic') and its number, or none of "
            "them for a law without damping"
        )
    slopes = {}
    for name, force in (("elastic", elastic), ("damper", law.damper)):
        text = getattr(law, f"{name}_slope")
        for formula in (force, text):
            if formula:
                formulas.check(formula, formulas.FORCE_NAMES)
        if text and force and not _is_slope(text, force):
            raise LawError(f"{name}_slope {text!r} is not the derivative of {force!r} by d; leave it out")
        slopes[f"{name}_slope"] = text or (formulas.slope(force) if force else "0.0")
    damper, shape = law.damper, elastic
    if damper and not law.damper_slope:  # floors that are open don't act on each other
        damper, slopes["damper_slope"] = formulas.cut(damper), formulas.cut(slopes["damper_slope"])
    if n > 1.0 and not law.elastic_slope:
        elastic, slopes["elastic_slope"] = formulas.cut(elastic), formulas.cut(slopes["elastic_slope"])
    number = SOLVED if damper and law.number is None else law.number
    if number not in (None, SOLVED):
        formulas.check(number, formulas.NUMBER_NAMES)
        numbers = formulas.on_arrays(number, e=_NOMINAL)
        if (wrong := ~(np.isfinite(numbers) & (numbers >= 0.0))).any():
            e = _NOMINAL[wrong][0]
            raise LawError(f"damping number {number!r} at e = {e:.3g} must be a number >= 0 for every 0 < e <= 1")
    spring = _force(elastic, n, "elastic")
    power = np.round(np.log2(spring[1] / spring[0]), 6)
    if power != round(n, 6):
        raise LawError(f"elastic {elastic!r} begins as d^{power:g}, and the exponent is {n:g}; make them agree")
    relation, factor = law.relation, law.relation_factor
    dashpot = _force(damper, None, "damper") if damper else np.ones(2)
    if relation is None:
        relation, factor = _relation(law, spring, dashpot) if damper else ("", 1.0)
    if number == SOLVED and not relation:
        raise LawError(
            "number is missing, and no closed form is known of the rebound: it may depend on the approach velocity; "
            "give the damping number as published, a formula of e"
        )
    if law.approach_only and law.rebound_only:
        raise LawError("its damper can't act on approach only and on rebound only; leave one of them out")
    phase = " on approach" * law.approach_only + " on rebound" * law.rebound_only
    return {
        "title": title,
        "elastic": elastic,
        "damper": damper,
        **slopes,
        "damper_exponent": float(np.round(np.log2(dashpot[1] / dashpot[0]), 6)),
        "relation": relation,
        "relation_factor": factor,
        "formula": law.formula or f"F = {shape}" + (f" + {law.damper}*v{phase}" if damper else ""),
        "number": number,
        "number_text": law.number_text or number or "",
        "zero_restitution": law.zero_restitution or (number == SOLVED and RELATIONS[relation or ""].smallest == 0.0),
    }


def _tried(text: str, depths: np.ndarray, coefficient: float = 1.0) -> np.ndarray:
    """Values of the formula of a force at penetrations."""
    return formulas.on_arrays(text, d=depths, k=coefficient, c=coefficient) * np.ones(len(depths))


def _is_constant(ratio: np.ndarray) -> bool:
    return bool(np.ptp(ratio) <= _RTOL * ratio[0])


def _is_slope(text: str, force: str) -> bool:
    """Whether a formula is the derivative of another one by d."""
    step = 1e-4 * _DEPTHS
    rise = (_tried(force, _DEPTHS + step) - _tried(force, _DEPTHS - step)) / (2.0 * step)
    return np.allclose(_tried(text, _DEPTHS), rise, rtol=1e-5, atol=1e-9)


def _force(text: str, exponent: float | None, what: str) -> np.ndarray:
    """Values of a formula at all penetrations; raise `LawError` where they won't do."""
    values, twice = _tried(text, _DEPTHS), _tried(text, _DEPTHS, 2.0)
    wrong = ~(np.isfinite(values) & (values > 0.0))
    if wrong.any():
        raise LawError(
            f"{what} {text!r} is {values[wrong][0]:g} at d = {_DEPTHS[wrong][0]:.3g} m, with k = c = 1; it must be > 0"
        )
    if not np.allclose(twice, 2.0 * values, rtol=_RTOL, atol=0.0):
        name = "c" if exponent is None else "k"
        raise LawError(f"{what} {text!r} must be proportional to {name}, which carries the unit")
    if exponent is not None and not (np.diff(values) > 0.0).all():
        raise LawError(f"{what} {text!r} must grow with d")
    return values


def _relation(law: Law, spring: np.ndarray, dashpot: np.ndarray) -> tuple[str, float]:
    """Relation between damping number and restitution, and the factor of the number; ("", 1) where none is known."""
    n = law.exponent or 1.0
    if law.damping == "elastic" and _is_constant(ratio := dashpot / spring):
        name = "approach" if law.approach_only else "rebound" if law.rebound_only else "both_phases"
        return name, float(np.round(ratio[0], 12))
    # w = d^((n + 1) / 2) makes it a linear dashpot beside a linear spring
    if (
        law.damping == "viscous"
        and not law.rebound_only
        and _is_constant(spring / _DEPTHS**n)
        and _is_constant(ratio := dashpot / _DEPTHS ** (0.5 * (n - 1.0)))
    ):
        name = "dashpot_approach" if law.approach_only else "dashpot_tension" if law.tension else "dashpot_clipped"
        return name, float(ratio[0] * math.sqrt(2.0 / (n + 1.0)))
    return "", 1.0


#: All laws by key, in the order in which they are listed.
LAWS: dict[str, Law] = {
    key: Law(**{"key": key, "exponent": None, **law}) for key, law in read_data("laws.toml").items()
}
#: The paper's Models I to VII in its order.
MATE2015_MODELS = (
    *("linear", "kelvin_voigt", "modified_kelvin_voigt", "hertz"),
    *("hertz_damped", "nonlinear_viscoelastic", "none"),
)
#: Groups of laws that a sweep may name in place of each law.
LAW_GROUPS = {"all": tuple(LAWS), "mate2015": MATE2015_MODELS}


def get_law(key: str | Law) -> Law:
    """Return the law of that key; a `Law` is returned as it is.

    Raises
    ------
    LawError
        The key is unknown; the message lists the valid ones.

    Examples
    --------
    >>> get_law("kelvin_voigt").takes_restitution
    True
    """
    if isinstance(key, Law):
        return key
    try:
        return LAWS[key]
    except (KeyError, TypeError):
        text = f"{unknown('contact law', key, LAWS)}; a sweep may name a law of your own as FILE.py:NAME, or a group: "
        raise LawError(text + ", ".join(LAW_GROUPS)) from None


def names_file(text: str) -> bool:
    """Whether a law is named by a file and a name in it."""
    return text.partition(":")[0].endswith(".py") or ".py:" in text


def find_law(value: Any, base: Path | None = None) -> Law:
    """Return a law by its key, one of a file (from the folder `base`) by FILE:NAME, or one of a user's own, checked."""
    law = _load(value, base) if isinstance(value, str) and names_file(value) else get_law(value)
    if LAWS.get(law.key) == law:
        return LAWS[law.key]
    where = f"law {law.key!r}"
    if law.key in LAWS or law.key in LAW_GROUPS:
        raise LawError(f"{where} has the key of a law or group that is there already; give it another key")
    if law.damping in ("jump", "yield") or law.exponent is None:
        raise LawError(
            f"{where} has damping {law.damping!r} and exponent {law.exponent}; a law of your own has a force"
        )
    return law


def _load(text: str, base: Path | None) -> Law:
    """Run a law file and return the law of that name."""
    path, _, name = text.rpartition(":")
    if not path.endswith(".py") or not name.isidentifier():
        raise LawError(f"{text!r} names no law of a file; give FILE.py:NAME, such as mylaws.py:my_law")
    file = expanded(path) if base is None else Path(base) / expanded(path)
    if not file.is_file():
        raise LawError(
            f"law file {str(file)!r} does not exist; give a path relative to the sweep file, or an absolute one"
        )
    try:
        variables = runpy.run_path(str(file), run_name=file.stem)
    except (Exception, SystemExit) as error:  # a user's file may raise anything
        lines = [entry.lineno for entry in traceback.extract_tb(error.__traceback__) if entry.filename == str(file)]
        line = getattr(error, "lineno", None) or (lines[-1] if lines else 1)
        raise LawError(f"law file {file!s}:{line}: {type(error).__name__}: {error}") from None
    law = variables.get(name)
    if not isinstance(law, Law):
        laws = ", ".join(key for key, value in variables.items() if isinstance(value, Law))
        what = f"{name} is {repr_short(law)}, no Law" if name in variables else f"there is no {name!r}"
        raise LawError(f"law file {file!s}: {what}; laws in it: {laws or 'none (see pounding_sweep.Law)'}")
    object.__setattr__(law, "source", f"{file}:{name}")
    return law


#: Name of the law of `rubber_bumper`, which the thickness completes.
RUBBER = "rubber_bumper"


@partial(checked_call, LawError)
def rubber_bumper(
    thickness: Positive,
    *,
    stiffness: Positive | None = None,
    key: str = RUBBER,
    exponent: Annotated[Number, Field(ge=1.0, le=10.0)] = 2.65,
    limit: Annotated[Number, Field(gt=0.0, le=1.0)] = 0.8,
    stop: Annotated[Number, Field(ge=1.0, allow_inf_nan=False)] = 1.0,
) -> Law:
    """Return the contact law of rubber bumpers between the floors of neighbours.

    On approach F = k d^n, d the compression, as far as the share `limit` of the thickness, and from there on a straight
    line; on rebound this force times (1 + D v / v0), D such that two free masses rebound at exactly the restitution.

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

    Raises
    ------
    LawError
        A number is out of its range.

    References
    ----------
    Polycarpou, Komodromos & Polycarpou (2013), Earthquake Eng. Struct. Dyn. 42(1), 81-100. Only the abstract was at
    hand: the form of the force and the exponent are from memory, the damping is another one; see the page on theory.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> pad = ps.rubber_bumper(0.05, stiffness=500 / 0.04**2.65)  # 500 kN at 40 mm
    >>> pad.thickness, pad.stiffness_unit, pad.relation
    (0.05, 'kN m-2.65', 'rebound')
    """
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
        thickness=thickness,
        reference_stiffness=stiffness,
        formula=(
            f"F = E on approach, max(0, E (1 + D v / v0)) on rebound; E = k d^{exponent:g} as far as {flat:g} m, "
            f"from there on a straight line of {stop:g} times its slope"
        ),
        reference="after Polycarpou, Komodromos & Polycarpou (2013), Earthquake Eng. Struct. Dyn. 42(1), 81-100",
    )


@partial(checked_call, LawError)
def hertz_stiffness(
    mass_1: Positive | None = None,
    mass_2: Positive | None = None,
    *,
    young_modulus: Positive = 25.0e6,
    poisson_ratio: Annotated[Number, Field(ge=0.0, lt=0.5)] = 0.2,
    density: Positive = 2.5,
    radii: Annotated[tuple[Positive, Positive], faults.Listed] | None = None,
) -> float:
    """Hertz contact stiffness of two spheres (kN/m^1.5): 4 / (3 pi (h1 + h2)) sqrt(R1 R2 / (R1 + R2)).

    Equations 9 to 11 of Mate, Bakre & Jaiswal (2015), corrected: the radius is the *cube* root of the sphere's volume
    relation, and the material term is h = (1 - nu**2) / (pi E) (Goldsmith 1960).

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

    Raises
    ------
    LawError
        A value is not positive, or neither masses nor radii are given.

    Examples
    --------
    >>> round(hertz_stiffness(133.956, 136.286) / 1e7, 3)
    1.88
    """
    if radii is not None and mass_1 is mass_2 is None:
        r1, r2 = radii
    elif radii is None and mass_1 is not None and mass_2 is not None:
        r1, r2 = (((3.0 * m) / (4.0 * math.pi * density)) ** (1.0 / 3.0) for m in (mass_1, mass_2))
    else:
        raise LawError("hertz_stiffness needs either two masses (t) or radii=(R1, R2) (m)")
    h = (1.0 - poisson_ratio**2) / (math.pi * young_modulus)
    return 4.0 / (3.0 * math.pi * 2.0 * h) * math.sqrt(r1 * r2 / (r1 + r2))


# --- restitution ---


def realised_validity(law: Law) -> str:
    """Coefficients of restitution that a law can realise exactly, as text."""
    if not law.takes_restitution or law.impulsive:
        return law.validity
    if not law.relation:
        return "none: its damping has no known relation to the realised restitution"
    return f"{RELATIONS[law.relation].smallest:g} <= e <= 1"


def _check_realisable(law: Law, e: float) -> None:
    """Raise `LawError` unless some finite damping makes two free masses rebound at exactly `e`."""
    if law.impulsive:
        return
    smallest = RELATIONS[law.relation].smallest if law.relation else math.inf
    if not smallest <= e <= 1.0:
        hint = ", or a law that realises e = 0: kelvin_voigt_tension or stereomechanical" if smallest < 1.0 else ""
        valid = f"{realised_validity(law)}{hint}, or restitution_basis='published'"
        raise LawError(f"restitution {e!r} can't be realised by law {law.key!r}; give {valid}")


def realised_number(law: Law, e: Any) -> np.ndarray:
    """Damping number with which two free masses rebound at exactly `e`; relative error below 1e-12.

    Parameters
    ----------
    law : Law
        Contact law.
    e : array_like
        Coefficient of restitution wanted.

    Returns
    -------
    ndarray
        Shape of `e`, dimensionless; zero for laws without damping, `e` itself for a velocity jump.

    Raises
    ------
    LawError
        No finite damping does it; the message says which `e` are valid.

    Examples
    --------
    >>> float(realised_number(get_law("hertz_damped"), 0.6).round(6))
    0.974872
    """
    values = np.asarray(e, dtype=float)
    if law.number is None or law.impulsive:
        return damping_number(law, values)
    distinct, inverse = np.unique(values, return_inverse=True)  # a sweep repeats few values in many scenarios
    for value in distinct[[0, -1]] if distinct.size else ():  # NaN sorts last
        _check_realisable(law, float(value))
    relation = RELATIONS[law.relation or ""]
    inside = (distinct > 0.0) & (distinct < 1.0)
    solved = relation.number(np.where(inside, distinct, 0.5)) / law.relation_factor
    ends = np.where(distinct > 0.0, 0.0, relation.at_zero / law.relation_factor)
    return np.where(inside, solved, ends)[inverse].reshape(values.shape)


def damping_number(law: Law, e: Any, basis: str = "published") -> np.ndarray:
    """Damping number of a law that takes restitution, on either basis; 0 for others."""
    check_basis(basis)
    values = np.asarray(e, dtype=float)
    if law.number is None:
        return np.zeros(values.shape)
    if law.number == SOLVED or (basis == "realised" and not law.impulsive):
        return realised_number(law, values)
    return formulas.on_arrays(law.number, e=values) * np.ones(values.shape)


def realised_restitution(law: Law, e: Any, basis: str = "published") -> np.ndarray:
    """Restitution that two free masses really have under a law of nominal restitution `e`.

    Parameters
    ----------
    law : Law
        Contact law.
    e : array_like
        Nominal coefficient of restitution.
    basis : {"published", "realised"}
        What `e` means; with "realised" it is returned as it is.

    Returns
    -------
    ndarray
        Shape of `e`; 1 for laws without damping, NaN without contact or where the relation is not known.

    Raises
    ------
    LawError
        `e` is not valid for the law on that basis, or the basis is unknown.

    Examples
    --------
    >>> float(realised_restitution(get_law("hertz_damped"), 0.6).round(3))
    0.756
    """
    check_basis(basis)
    values = np.asarray(e, dtype=float)
    if not law.takes_restitution:
        return np.full(values.shape, 1.0 if law.has_contact else np.nan)
    for value in (values.min(), values.max()) if values.size else ():
        law.check_restitution(float(value), basis)
    if basis == "realised" or law.impulsive:
        return values.copy()
    if not law.relation:
        return np.full(values.shape, np.nan)
    number = damping_number(law, values) * law.relation_factor
    damped = number > 0.0
    rebound = RELATIONS[law.relation].restitution(np.where(damped, number, 1.0))
    return np.where(damped, rebound, 1.0)
