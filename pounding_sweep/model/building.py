"""A building: masses, stiffness, damping and hysteresis of its storeys, and what it stands on.

Units kN, t, m, s: consistent as they stand (1 kN = 1 t m/s2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError, Place, SceneError, repr_short
from pounding_sweep.base.text import label_fault
from pounding_sweep.model import faults as model_faults
from pounding_sweep.model.faults import Fraction, NotNegative, Positive, checked, derived, one_or_several, set_fields
from pounding_sweep.model.storeys import DEFAULT, STOREY_LAWS, Hysteresis, StoreyLaw, law_of, list_lengths, of_storey

#: Storey height where none is given (m).
DEFAULT_STOREY_HEIGHT = 3.0
#: Below these shares of the stiffness of the storey above, at first and after yielding, a first storey is of isolators.
ISOLATING = (0.25, 0.1)
#: Largest error of shares that sum up to one.
ROUNDING = 1e-9
#: Largest difference of entries across the diagonal, over the largest entry, that counts as rounding.
SYMMETRIC = 1e-6
#: Stiffnesses that Rayleigh damping may follow in storeys that yield.
DAMPING_STIFFNESSES = ("initial", "tangent")
#: What a building has of each storey; hardening may be one number.
_LISTS = (
    *("stiffnesses", "storey_heights", "yield_strengths", "slab_depths", "column_stiffnesses", "dashpots"),
    "hardening",
)


def _label(name: Any) -> str:
    """Return the name of a building or wall; `InputError` unless it can be one."""
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"must be a name, a non-empty text, not {repr_short(name)}")
    if fault := label_fault(name):
        raise InputError(f"{repr_short(name)} {fault}; give another name")
    return name


def _as_matrix(value: Any, info: ValidationInfo) -> Any:
    """Return rows of numbers, of a list of them, an array, or a file in the folder `base` of the context, as tuples."""
    if isinstance(value, str):
        file = Path((info.context or {}).get("base") or ".", value)
        try:
            value = np.loadtxt(file, delimiter=",", ndmin=2)
        except (OSError, ValueError) as error:
            raise InputError(f"{value!r} could not be read as rows of numbers between commas: {error}") from None
    if not isinstance(value, (list, tuple, np.ndarray)):
        return value
    return tuple(tuple(row) if isinstance(row, (list, tuple, np.ndarray)) else row for row in value)


#: A name of a building or wall, values of storeys, and one value or several.
Label = Annotated[str, BeforeValidator(_label)]
Positives = Annotated[Sequence[Positive], model_faults.Listed]
#: Values of storeys, or one number for all of them.
OfStoreys = Annotated[Sequence[float], one_or_several(Positive, Sequence[Positive])]
OfStoreysOrZero = Annotated[Sequence[float], one_or_several(NotNegative, Sequence[NotNegative])]
#: A square matrix, by rows.
Matrix = Annotated[Sequence[Sequence[model_faults.Finite]], BeforeValidator(_as_matrix)]
#: Strengths of storeys, infinite (null in JSON) where they never yield.
_Strength = Annotated[model_faults.Number, Field(gt=0.0)]
_Strengths = Sequence[Annotated[_Strength, BeforeValidator(lambda value: math.inf if value is None else value)]]
Strengths = Annotated[Sequence[float], one_or_several(_Strength, _Strengths)]


@checked
class Foundation:
    """A rigid foundation under a building, free to sway and to rock on the soil's springs and dashpots.

    Two degrees of freedom beside the building's floors: the base's displacement relative to the free field and its
    rotation. At a rotation theta a floor at elevation h moves by h theta with its base.

    Parameters
    ----------
    mass : float
        Mass (t) of the base.
    inertia : float
        Mass moment of inertia (t m2) of the base about its own centre, and of the floors about theirs: their masses at
        their elevations are not part of it.
    sway_stiffness : float
        Stiffness K_h (kN/m) of the soil against sway.
    rocking_stiffness : float
        Stiffness K_theta (kN m/rad) of the soil against rocking.
    sway_damping : float
        Coefficient c_h (kN s/m) of the soil's dashpot against sway, of its material and of radiation.
    rocking_damping : float
        Coefficient c_theta (kN m s/rad) of that against rocking.

    Raises
    ------
    SceneError
        A value is not a positive number, or a damping is negative.

    References
    ----------
    Veletsos & Meek (1974), Dynamic behaviour of building-foundation systems, Earthq. Eng. Struct. Dyn. 3, 121-138.
    Wolf (1985), Dynamic soil-structure interaction, Prentice-Hall.

    Examples
    --------
    >>> from pounding_sweep import Building
    >>> soft = Foundation(mass=100.0, inertia=800.0, sway_stiffness=4e5, rocking_stiffness=9e6)
    >>> firm, swaying = Building("a", [100.0], [1e5]), Building("a", [100.0], [1e5], foundation=soft)
    >>> round(float(firm.periods[0]), 3), round(float(swaying.periods[0]), 3)
    (0.199, 0.236)
    """

    mass: Positive
    inertia: Positive
    sway_stiffness: Positive
    rocking_stiffness: Positive
    sway_damping: NotNegative = 0.0
    rocking_damping: NotNegative = 0.0

    #: Of sway and of rocking.
    masses = property(lambda self: np.array([self.mass, self.inertia]))
    stiffnesses = property(lambda self: np.array([self.sway_stiffness, self.rocking_stiffness]))
    dashpots = property(lambda self: np.array([self.sway_damping, self.rocking_damping]))


@checked
class Infill:
    """A second spring of each storey beside its own: an infill wall, which may crack, slip and drop out.

    Parameters
    ----------
    stiffnesses : float or sequence of float
        Stiffness (kN/m) of the infill of each storey, bottom first, or of all; 0 in storeys without infill.
    yield_strengths : float or sequence of float
        Its shear (kN) at first yield.
    hardening : float or sequence of float
        Its stiffness after first yield over its elastic one, in [0, 1).
    hysteresis : mapping, optional
        Storey law of the infill and its parameters; bilinear if not given.

    Raises
    ------
    SceneError
        A value is out of range.

    Examples
    --------
    >>> from pounding_sweep import Building
    >>> frame = Building("a", [100.0, 100.0], [5e4, 5e4], yield_strengths=[200.0, 150.0])
    >>> walls = Infill(stiffnesses=[0.0, 2e5], yield_strengths=[0.0, 300.0])
    >>> infilled = Building("b", [100.0, 100.0], [5e4, 5e4], yield_strengths=[200.0, 150.0], infill=walls)
    >>> round(float(frame.periods[0]), 3), round(float(infilled.periods[0]), 3)
    (0.455, 0.408)
    """

    stiffnesses: OfStoreysOrZero
    yield_strengths: OfStoreysOrZero
    hardening: Annotated[float | Sequence[float], one_or_several(Fraction, Sequence[Fraction])] = 0.0
    hysteresis: Hysteresis | None = None


@checked
class Building:
    """A shear building, linear elastic unless its storeys yield; or any linear one, by its floors' stiffness matrix.

    Parameters
    ----------
    name : str
        Coordinate label in every result.
    masses : sequence of float
        Floor masses (t), bottom first.
    stiffnesses : float or sequence of float, optional
        Storey stiffnesses (kN/m), bottom first; one number is that of every storey, here and below.
    damping_ratio : float or (float, float)
        Rayleigh damping ratio of the first two modes, or one each. A one-storey building has c = 2 zeta w m.
    storey_heights : float or sequence of float, optional
        Storey heights (m), 3 m each where not given.
    yield_strengths : float or sequence of float, optional
        Storey shears (kN) at first yield, bottom first; infinite where a storey never yields, as all do by default.
    hardening : float or sequence of float
        Stiffness of a storey that yields over its elastic one, in [0, 1).
    damping_stiffness : {"initial", "tangent"}
        Stiffness that Rayleigh damping follows in storeys that yield.
    slab_depths : float or sequence of float, optional
        Depths of the floors' slabs (m), from the floor's elevation down, each less than its storey's height; 0 where
        not given. Floors of neighbours meet where their slabs overlap.
    column_stiffnesses : float or sequence of float, optional
        Lateral stiffnesses 12 E I / L^3 (kN/m) of those columns of each storey that a neighbour's floor strikes; those
        of the storeys where not given.
    p_delta : bool
        Weights above a storey act on its drift: its lateral stiffness is less by P / h, of the weight P = m g above it
        (kN) and its height h, also in periods, modes and Rayleigh damping.
    hysteresis : mapping or sequence of mapping, optional
        Law of the storeys that yield and its parameters, ``{"law": "bouc_wen", "n": 2.0}``; bilinear with kinematic
        hardening where not given. Several are elements of each such storey side by side, which share its stiffness and
        strength by their ``stiffness_share`` and ``strength_share``.
    infill : Infill or mapping, optional
        A second spring of each storey beside its own, also in periods, modes and Rayleigh damping.
    dashpots : float or sequence of float, optional
        Coefficients (kN s/m) of dashpots between each floor and the one below (the ground), bottom first, beside
        Rayleigh's damping.
    foundation : Foundation or mapping, optional
        What the building stands on, free to sway and to rock; fixed to the ground where not given. Rayleigh damping is
        that of the building on a fixed base, and acts on its motion relative to the base.
    base_elevation : float
        Elevation (m) of the building's base above the datum of the row, below 0 for one that is deeper.
    stiffness_matrix : array_like or str, optional
        Lateral stiffness matrix (kN/m) of the floors on a fixed base, bottom first, without P-Delta, in place of
        `stiffnesses`; or a file of its rows, numbers between commas. Such a building is linear.
    modal_damping : float or sequence of float, optional
        Damping ratio of all modes on a fixed base, or of each, slowest first, in place of Rayleigh damping.
    damping_matrix : array_like or str, optional
        Damping matrix (kN s/m) of the floors on a fixed base, in place of Rayleigh damping.
    period : float, optional
        First period (s) on a fixed base without P-Delta: all stiffnesses are multiplied by one number to give it.

    Raises
    ------
    SceneError
        A value is out of range, lists differ in length, parts exclude each other, or the building does not stand.

    Examples
    --------
    >>> b = Building("left", [173.331, 173.331, 133.956], [555.55e3] * 3)
    >>> [round(float(t), 4) for t in b.periods[:1]]
    [0.2337]
    """

    name: Label
    masses: Annotated[Positives, Field(min_length=1)]
    stiffnesses: OfStoreys | None = None
    damping_ratio: Annotated[float | Sequence[float], one_or_several(Fraction, tuple[Fraction, Fraction])] = 0.05
    storey_heights: OfStoreys | None = None
    yield_strengths: Strengths | None = None
    hardening: Annotated[float | Sequence[float], one_or_several(Fraction, Sequence[Fraction])] = 0.0
    damping_stiffness: Annotated[str, model_faults.one_of("damping_stiffness", DAMPING_STIFFNESSES)] = "initial"
    slab_depths: OfStoreysOrZero | None = field(default=None, kw_only=True)
    column_stiffnesses: OfStoreys | None = field(default=None, kw_only=True)
    p_delta: model_faults.Flag = field(default=False, kw_only=True)
    hysteresis: Annotated[Any, one_or_several(Hysteresis, Sequence[Hysteresis])] | None = field(
        default=None, kw_only=True
    )
    infill: Infill | None = field(default=None, kw_only=True)
    dashpots: OfStoreysOrZero | None = field(default=None, kw_only=True)
    foundation: Foundation | None = field(default=None, kw_only=True)
    base_elevation: model_faults.Finite = field(default=0.0, kw_only=True)
    stiffness_matrix: Matrix | None = field(default=None, kw_only=True)
    modal_damping: OfStoreysOrZero | None = field(default=None, kw_only=True)
    damping_matrix: Matrix | None = field(default=None, kw_only=True)
    period: Positive | None = field(default=None, kw_only=True)
    FILE_KEYS: ClassVar = ("isolation", "typical")  # a sweep file's reader replaces it
    n_storeys: int = derived()
    infill_stiffnesses: tuple[float, ...] = derived()  # of each storey (kN/m), zeros without infill
    #: of each storey: whether it or its infill may yield, its hardening, and whether it has a dashpot
    yields: tuple[bool, ...] = derived()
    hardenings: tuple[float, ...] = derived()
    dashed: tuple[bool, ...] = derived()
    uniform_hardening: float = derived()  # of all storeys, NaN if they differ
    elevations: np.ndarray = derived()  # of floors above the building's base (m), shape (n_storeys,)
    levels: np.ndarray = derived()  # of floors above the datum of the row (m), shape (n_storeys,)
    #: what the weights above take of each storey's lateral stiffness (kN/m), P / h, zeros without `p_delta`; what they
    #: leave of it (kN/m); and P / (k h)
    geometric_stiffnesses: tuple[float, ...] = derived()
    #: drift (m) at which a storey falls, infinite where it never does: with `p_delta` the height of one that yields
    drift_limits: tuple[float, ...] = derived()
    lateral_stiffnesses: tuple[float, ...] = derived()
    storey_stiffnesses: tuple[float, ...] = derived()  # `stiffnesses`, NaN of a building by its matrix
    stability_coefficients: tuple[float, ...] = derived()

    def __post_init__(self) -> None:
        n, hardening = len(self.masses), self.hardening
        if self.stiffnesses is None and self.stiffness_matrix is None:
            missing = "is missing; give Storey stiffnesses (kN/m), bottom first, or a stiffness_matrix of the floors"
            raise SceneError(missing, ("stiffnesses",))
        single = [name for name in _LISTS if isinstance(getattr(self, name), float) and name != "hardening"]
        set_fields(self, **{name: (getattr(self, name),) * n for name in single})
        hardenings = hardening if isinstance(hardening, tuple) else (hardening,) * n
        infill = self.of_infill("stiffnesses")
        strengths = zip(self.yield_strengths or (math.inf,) * n, infill, strict=False)
        heights = self.storey_heights or (DEFAULT_STOREY_HEIGHT,) * n
        elevations = np.cumsum(heights)
        set_fields(
            self,
            n_storeys=n,
            infill_stiffnesses=infill,
            storey_heights=heights,
            elevations=elevations,
            levels=self.base_elevation + elevations,
            yields=tuple(math.isfinite(strength) or k > 0.0 for strength, k in strengths),
            hardenings=hardenings,
            uniform_hardening=hardenings[0] if len(set(hardenings)) == 1 else math.nan,
            dashed=tuple(c > 0.0 for c in self.dashpots or (0.0,) * n),
        )
        with model_faults.Faults() as faults:
            self._check_parts(faults.add)
            if not faults.entries:
                self._scale_to_period()
                weights = np.cumsum(np.multiply(self.masses[::-1], STANDARD_GRAVITY * self.p_delta))[::-1]
                geometric = weights / heights
                stiffnesses = np.array(self.stiffnesses or (math.nan,) * n)
                lateral = stiffnesses - geometric + self.infill_stiffnesses
                set_fields(
                    self,
                    drift_limits=tuple(np.where(np.multiply(self.yields, self.p_delta), heights, math.inf).tolist()),
                    geometric_stiffnesses=tuple(geometric.tolist()),
                    storey_stiffnesses=tuple(stiffnesses.tolist()),
                    stability_coefficients=tuple((geometric / stiffnesses).tolist()),
                )
                if self.stiffness_matrix is not None:  # of what resists each drift alone
                    drifts = self.drifts[:, :n]
                    lateral = 1.0 / np.diag(drifts @ np.linalg.inv(self.lateral_matrix) @ drifts.T)
                set_fields(self, lateral_stiffnesses=tuple(lateral.tolist()))
                self._check_building(faults.add)

    def _scale_to_period(self) -> None:
        """Multiply the stiffnesses by the one number that gives the first period asked for."""
        if self.period is None:
            return
        stiff = self._without_weights
        root = 1.0 / np.sqrt(self.masses)
        factor = (2.0 * math.pi / self.period) ** 2 / np.linalg.eigvalsh(stiff * np.outer(root, root))[0]
        if self.infill is not None:
            walls = tuple(factor * k for k in self.infill_stiffnesses)
            set_fields(self, infill_stiffnesses=walls, infill=replace(self.infill, stiffnesses=walls))
        if self.stiffness_matrix is not None:
            set_fields(self, stiffness_matrix=tuple(map(tuple, (factor * stiff).tolist())))
        else:
            set_fields(self, stiffnesses=tuple(factor * k for k in self.stiffnesses or ()))
        set_fields(self, period=None)  # factors act after it

    @property
    def _without_weights(self) -> np.ndarray:
        """Lateral stiffness matrix (kN/m) of the floors on a fixed base, without P-Delta."""
        if self.stiffness_matrix is not None:
            return np.array(self.stiffness_matrix)
        drifts = self.drifts[:, : self.n_storeys]
        return (drifts.T * np.add(self.stiffnesses or (), self.infill_stiffnesses)) @ drifts

    @cached_property
    def lateral_matrix(self) -> np.ndarray:
        """What weights leave of the lateral stiffness matrix (kN/m) of the floors on a fixed base."""
        drifts = self.drifts[:, : self.n_storeys]
        return self._without_weights - (drifts.T * self.geometric_stiffnesses) @ drifts

    @property
    def falls(self) -> tuple[bool, ...]:
        """Whether each storey may fall: at a drift, or as its own springs fail."""
        return tuple(
            math.isfinite(limit)
            or (self.yields[i] and all(law.can_fail or is_infill for law, _, is_infill in self.springs_of(i)))
            for i, limit in enumerate(self.drift_limits)
        )

    def _check_parts(self, fault: Callable[[Place, str], None]) -> None:
        """Tell of parts that do not go together."""
        n = self.n_storeys
        for name in _LISTS:
            if isinstance(values := getattr(self, name), tuple) and len(values) != n:
                fault((name,), f"{len(values)} values for {n} masses; give one per storey")
        self._check_matrices(fault)
        for name in ("stiffnesses", "yield_strengths", "hardening") if self.infill else ():
            if len(values := self.of_infill(name)) != n:
                fault(("infill", name), f"{len(values)} values for {n} masses; give one per storey")
            elif name == "yield_strengths" and any(
                k and not v for k, v in zip(self.infill_stiffnesses, values, strict=False)
            ):
                fault(("infill", name), "is 0 in a storey whose infill has a stiffness; give it a strength")
        if self.yield_strengths is None:
            for name, default in (("hardening", 0.0), ("damping_stiffness", "initial"), ("hysteresis", None)):
                if getattr(self, name) != default:
                    fault((name,), f"{name} is that of storeys that yield; give yield_strengths too, or leave it out")
        laws = [("hysteresis", element) for element in self.elements]
        for place, element in (*laws, *(("infill", element) for element in self.infill_elements)):
            if self.damping_stiffness == "tangent" and not STOREY_LAWS[element.law].has_tangent:
                why = f"{element.law} has no tangent stiffness that is one number while a storey yields"
                fault(("hysteresis",), f'{why}; give damping_stiffness = "initial"')
            for name, length in list_lengths(element).items():
                if length != n:
                    fault((place, name), f"{length} values for {n} masses; give one per storey")
        for name in ("stiffness_share", "strength_share"):
            if abs(total := math.fsum(getattr(element, name) for element in self.elements) - 1.0) > ROUNDING:
                fault(("hysteresis",), f"the sum of {name} of all elements is {1.0 + total:g}; it must be 1")
        if self.damping_stiffness == "tangent" and self.p_delta:
            fault(
                ("p_delta",),
                "with p_delta the tangent stiffness of a storey that yields may be negative, and damping that follows "
                'it would put energy in; give damping_stiffness = "initial", or leave out p_delta',
            )
        if self.p_delta and self.foundation:
            why = "p_delta and a foundation do not go together, as weights would act on its rocking too"
            fault(("foundation",), f"{why}; leave one of them out")

    def _check_matrices(self, fault: Callable[[Place, str], None]) -> None:
        """Tell of matrices and modal damping that are none of the building."""
        n = self.n_storeys
        if self.stiffness_matrix is not None:
            if self.stiffnesses is not None:
                fault(("stiffness_matrix",), "comes beside stiffnesses; leave one of them out")
            if any(self.yields):
                why = "storeys that yield, or infill, need stiffnesses of storeys, which a stiffness_matrix has not"
                fault(("yield_strengths",), f"{why}; leave one of them out")
        if self.modal_damping is not None and self.damping_matrix is not None:
            fault(("damping_matrix",), "comes beside modal_damping; leave one of them out")
        if isinstance(self.modal_damping, tuple) and len(self.modal_damping) != n:
            fault(("modal_damping",), f"{len(self.modal_damping)} ratios for {n} modes; give one for all, or one each")
        for name in ("stiffness_matrix", "damping_matrix"):
            if (rows := getattr(self, name)) is None:
                continue
            if len(rows) != n or any(len(row) != n for row in rows):
                sizes = " x ".join(map(str, (len(rows), *{len(row) for row in rows})))
                fault((name,), f"is {sizes} for {n} masses; it has a row and a column for each floor, bottom first")
                continue
            matrix = np.array(rows)
            unlike = np.abs(matrix - matrix.T)
            i, j = np.unravel_index(np.argmax(unlike), unlike.shape)
            if unlike[i, j] > SYMMETRIC * np.abs(matrix).max():
                entries = f"{matrix[i, j]:g} and {matrix[j, i]:g}"
                fault((name,), f"is not symmetric: entries {i + 1}, {j + 1} and {j + 1}, {i + 1} are {entries}")
                continue
            set_fields(self, **{name: tuple(map(tuple, (0.5 * (matrix + matrix.T)).tolist()))})
            lowest = np.linalg.eigvalsh(matrix)[0]
            if name == "stiffness_matrix" and not lowest > 0.0:
                fault((name,), f"is not positive definite: its lowest eigenvalue is {lowest:.4g} kN/m")
            if name == "damping_matrix" and lowest < -SYMMETRIC * np.abs(matrix).max():
                fault((name,), f"would feed energy in: its lowest eigenvalue is {lowest:.4g} kN s/m; it must be >= 0")

    def _check_building(self, fault: Callable[[Place, str], None]) -> None:
        """Tell what only the building shows, its parts being valid."""
        for i, (depth, height) in enumerate(zip(self.slab_depths or (), self.storey_heights or (), strict=False)):
            if depth >= height:
                fault(("slab_depths", i), f"is {depth:g} m; it must be less than the storey's height of {height:g} m")
        for storey, theta in enumerate(self.stability_coefficients):
            if theta >= 1.0:
                fault(
                    ("p_delta",),
                    f"storey {storey + 1} of stiffness {self.storey_stiffnesses[storey]:g} kN/m does not stand under "
                    f"the weight above it: its stability coefficient P / (k h) is {theta:.3g}, and must be below "
                    f"1; give it a stiffness above P / h = {self.geometric_stiffnesses[storey]:.4g} kN/m, or leave out "
                    "p_delta",
                )
        if self.stiffness_matrix is not None and (lowest := np.linalg.eigvalsh(self.lateral_matrix)[0]) <= 0.0:
            why = f"the lowest eigenvalue of what the weights leave of stiffness_matrix is {lowest:.4g} kN/m"
            fault(("p_delta",), f"the building does not stand under its weight: {why}; leave out p_delta")
            return
        if not min(self.rayleigh) >= 0.0:
            fault(
                ("damping_ratio",),
                f"{repr_short(self.damping_ratio)} gives the Rayleigh factors {self.rayleigh!r}, negative ones of "
                "which would feed energy in; bring the ratios of the first two modes closer together",
            )

    @property
    def elements(self) -> tuple[Any, ...]:
        """Parameters of storey laws of the elements of each storey that yields."""
        given = DEFAULT.Parameters() if self.hysteresis is None else self.hysteresis
        return given if isinstance(given, tuple) else (given,)

    def springs_of(self, storey: int) -> Iterator[tuple[StoreyLaw, Any, bool]]:
        """Go through the springs of a storey that yields: law and parameters of each, and whether it is infill."""
        yields = math.isfinite((self.yield_strengths or (math.inf,) * self.n_storeys)[storey])
        walls = self.infill_elements if self.infill_stiffnesses[storey] else ()
        for is_infill, elements in ((False, self.elements if yields else (DEFAULT.Parameters(),)), (True, walls)):
            for element in elements:
                parameters = of_storey(element, storey)
                yield law_of(element.law, STOREY_LAWS[element.law].compiled(parameters)), parameters, is_infill

    @property
    def infill_elements(self) -> tuple[Any, ...]:
        """Parameters of the storey law of the infill; none without it."""
        return () if self.infill is None else (self.infill.hysteresis or DEFAULT.Parameters(),)

    def of_infill(self, name: str) -> tuple[float, ...]:
        """Return numbers of the infill of each storey, zeros without it."""
        values = getattr(self.infill, name, 0.0)
        return values if isinstance(values, tuple) else (values,) * len(self.masses)

    @property
    def on_isolators(self) -> bool:
        """Whether the first storey is too soft for columns beside the one above: isolators."""
        first, above = (*(self.stiffnesses or ()), 0.0, 0.0)[:2]
        yielded = first * (self.hardenings[0] if self.yields[0] else 1.0)
        return first < ISOLATING[0] * above and yielded < ISOLATING[1] * above

    @property
    def inertias(self) -> np.ndarray:
        """Floor masses (t), with a foundation its mass and moment of inertia (t m2) after them, shape (n,)."""
        return np.array([*self.masses, *(self.foundation.masses if self.foundation else ())], dtype=float)

    @cached_property
    def deformations(self) -> np.ndarray:
        """Displacements of floors relative to the base, by those of floors, of the base and its rotation."""
        floors = np.eye(self.n_storeys)  # shape (n_storeys, n)
        if self.foundation is None:
            return floors
        return np.column_stack([floors, -np.ones(self.n_storeys), -self.elevations])

    @cached_property
    def drifts(self) -> np.ndarray:
        """Storey drifts by the same, shape (n_storeys, n)."""
        return np.diff(self.deformations, axis=0, prepend=0.0)

    @cached_property
    def damping_matrices(self) -> np.ndarray:
        """What Rayleigh's a and b multiply (t, kN/m), C of dashpots and of modes or given (kN s/m), shape (4, n, n)."""
        moved, drifts = self.deformations, self.drifts
        dashpots = (drifts.T * (self.dashpots or (0.0,) * self.n_storeys)) @ drifts
        if self.foundation is not None:
            dashpots[[-2, -1], [-2, -1]] += self.foundation.dashpots
        dense = np.zeros_like(dashpots) if self.modal_damping is None else self.damping_of_modes(self.modal_damping)
        dense = dense if self.damping_matrix is None else moved.T @ self.damping_matrix @ moved
        return np.stack([(moved.T * self.masses) @ moved, moved.T @ self.lateral_matrix @ moved, dashpots, dense])

    def damping_of_modes(self, ratios: float | Sequence[float]) -> np.ndarray:
        """Return C (kN s/m) of damping ratios of all modes on a fixed base, or of each, shape (n, n)."""
        frequencies, shapes = self.on_fixed_base.modes
        heavy = self.deformations.T @ (shapes * np.array(self.masses)[:, None])
        return (heavy * (2.0 * np.multiply(ratios, frequencies))) @ heavy.T

    @cached_property
    def system_matrix(self) -> np.ndarray:
        """K (kN/m) that weights leave, with a foundation by the base's displacement and rotation too."""
        stiff = np.asarray(self.deformations.T @ self.lateral_matrix @ self.deformations)
        if self.foundation is not None:
            stiff[[-2, -1], [-2, -1]] += self.foundation.stiffnesses
        return stiff

    @property
    def lateral_shears(self) -> np.ndarray:
        """Shears of storeys less what the weights push, by the same as `shears`."""
        return np.cumsum(self.lateral_matrix[::-1], axis=0)[::-1] @ self.deformations

    @property
    def dense_damping(self) -> np.ndarray:
        """Forces on floors of damping by matrices, by velocities of the same, shape (n_storeys, n)."""
        followed = self.rayleigh[1] * self.damping_matrices[1] if "k" in self.letters else 0.0
        return (self.damping_matrices[3] + followed)[: self.n_storeys]

    @cached_property
    def shears(self) -> np.ndarray:
        """What storeys bear (kN), by displacements of floors, of the base and its rotation, shape (n_storeys, n)."""
        return np.cumsum(self._without_weights[::-1], axis=0)[::-1] @ self.deformations

    @property
    def moment(self) -> np.ndarray:
        """Overturning moment at the base (kN m), by the same, shape (n,)."""
        return self.storey_heights @ self.shears

    @property
    def letters(self) -> str:
        """What matrices connect its floors: "k" stiffness, "m" damping of modes, "c" another damping."""
        values = {"k": self.stiffness_matrix, "m": self.modal_damping, "c": self.damping_matrix}
        return "".join(letter for letter, value in values.items() if value is not None)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Circular frequencies (rad/s), rising, and mass-normalised mode shapes (t^-1/2) in columns."""
        # with a foundation two more, of both together: shapes end with the base's displacement and rotation (rad/m)
        root = 1.0 / np.sqrt(self.inertias)
        values, vectors = np.linalg.eigh(self.system_matrix * np.outer(root, root))
        return np.sqrt(np.maximum(values, 0.0)), vectors * root[:, None]

    @property
    def frequencies(self) -> np.ndarray:
        """Natural circular frequencies (rad/s), rising."""
        return self.modes[0]

    @property
    def periods(self) -> np.ndarray:
        """Natural periods (s), falling."""
        return 2.0 * math.pi / self.frequencies

    @cached_property
    def on_fixed_base(self) -> Building:
        """The building without its foundation."""
        return self if self.foundation is None else replace(self, foundation=None)

    @cached_property
    def rayleigh(self) -> tuple[float, float]:
        """Factors (a, b) of C = a M + b K (1/s, s), from the first two modes on a fixed base; 0 of other damping."""
        ratios = self.damping_ratio
        return self.rayleigh_of(ratios if isinstance(ratios, tuple) else (ratios, ratios))

    def rayleigh_of(self, ratios: tuple[float, float]) -> tuple[float, float]:
        """Return the same of other damping ratios."""
        if self.modal_damping is not None or self.damping_matrix is not None:
            return 0.0, 0.0
        return rayleigh_factors(self.on_fixed_base.frequencies, ratios)


def rayleigh_factors(frequencies: np.ndarray, ratios: tuple[float, float]) -> tuple[float, float]:
    """Factors (a, b) (1/s, s) of the Rayleigh damping C = a M + b K of given ratios in the first two modes (rad/s)."""
    if len(frequencies) == 1:  # a = 2 zeta w
        return 2.0 * ratios[0] * float(frequencies[0]), 0.0
    w1, w2 = float(frequencies[0]), float(frequencies[1])
    b = 2.0 * (ratios[1] * w2 - ratios[0] * w1) / (w2**2 - w1**2)
    return 2.0 * ratios[0] * w1 - b * w1**2, b
