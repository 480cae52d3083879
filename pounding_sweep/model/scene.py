"""A row of buildings: masses, stiffness, damping, floors and gaps.

Units kN, t, m, s: consistent as they stand (1 kN = 1 t m/s2).
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pounding_sweep.base.errors import SceneError, shown
from pounding_sweep.base.tables import html_table
from pounding_sweep.base.text import label_fault

#: Floors of neighbours meet where their elevations agree within this (m).
FLOOR_TOLERANCE = 1.0e-3
#: Storey height where none is given (m).
DEFAULT_STOREY_HEIGHT = 3.0


def _numbers(what: str, unit: str, values: Sequence[float]) -> tuple[float, ...]:
    try:
        if isinstance(values, str | bytes):  # its characters are no values
            raise TypeError
        return tuple(float(v) for v in values)
    except (TypeError, ValueError, OverflowError):
        msg = f"{what} must be a list of numbers ({unit}), not {shown(values)}"
        raise SceneError(msg) from None


def _positive_list(
    owner: str, what: str, unit: str, values: Sequence[float], n: int | None = None
) -> tuple[float, ...]:
    result = _numbers(f"{owner}: {what}", unit, values)
    if not result:
        msg = f"{owner}: {what} is empty; give one value ({unit}) per storey, bottom first"
        raise SceneError(msg)
    if n is not None and len(result) != n:
        msg = f"{owner}: {len(result)} {what} for {n} masses; give one value per storey"
        raise SceneError(msg)
    for storey, value in enumerate(result, start=1):
        if not (math.isfinite(value) and value > 0):
            msg = f"{owner}: {what} of storey {storey} is {shown(value)} {unit}; it must be a positive number"
            raise SceneError(msg)
    return result


def _check_name(kind: str, name: str) -> None:
    if not isinstance(name, str) or not name.strip():
        msg = f"a {kind} needs a name, a non-empty text, not {shown(name)}"
        raise SceneError(msg)
    if fault := label_fault(name):
        msg = f"the name {shown(name)} of a {kind} {fault}; give it another one"
        raise SceneError(msg)


@dataclass(frozen=True)
class Building:
    """A linear elastic shear building.

    Parameters
    ----------
    name : str
        Coordinate label in every result.
    masses : sequence of float
        Floor masses (t), bottom first.
    stiffnesses : sequence of float
        Storey stiffnesses (kN/m), bottom first.
    damping_ratio : float or (float, float)
        Rayleigh damping ratio of the first two modes, or one each. A one-storey
        building has c = 2 zeta w m.
    storey_heights : sequence of float, optional
        Storey heights (m), 3 m each where not given.

    Raises
    ------
    SceneError
        A value is not positive, or the lists differ in length.

    Examples
    --------
    >>> b = Building("left", [173.331, 173.331, 133.956], [555.55e3] * 3)
    >>> [round(float(t), 4) for t in b.periods[:1]]
    [0.2337]
    """

    name: str
    masses: Sequence[float]
    stiffnesses: Sequence[float]
    damping_ratio: float | tuple[float, float] = 0.05
    storey_heights: Sequence[float] | None = None

    def __post_init__(self) -> None:
        _check_name("building", self.name)
        owner = f"building {self.name!r}"
        masses = _positive_list(owner, "masses", "t", self.masses)
        n = len(masses)
        object.__setattr__(self, "masses", masses)
        object.__setattr__(self, "stiffnesses", _positive_list(owner, "stiffnesses", "kN/m", self.stiffnesses, n))
        heights = [DEFAULT_STOREY_HEIGHT] * n if self.storey_heights is None else self.storey_heights
        object.__setattr__(self, "storey_heights", _positive_list(owner, "storey_heights", "m", heights, n))
        given = self.damping_ratio
        ratios = tuple(given) if isinstance(given, (tuple, list)) else (given,)
        if len(ratios) not in (1, 2) or not all(
            isinstance(z, numbers.Real) and math.isfinite(z) and 0 <= z < 1 for z in ratios
        ):
            msg = f"{owner}: damping_ratio {shown(given)} must be one or two numbers in [0, 1)"
            raise SceneError(msg)
        ratios = tuple(float(z) for z in ratios)
        object.__setattr__(self, "damping_ratio", ratios if len(ratios) == 2 else ratios[0])
        if not all(math.isfinite(c) for c in self.rayleigh):
            msg = f"{owner}: damping_ratio {shown(given)} gives no Rayleigh damping"
            raise SceneError(msg)
        if min(self.rayleigh) < 0:
            msg = (
                f"{owner}: damping ratios {shown(given)} in the first two modes need negative Rayleigh factors "
                f"{self.rayleigh!r}, which would feed energy in; bring the two ratios closer together"
            )
            raise SceneError(msg)

    @property
    def n_storeys(self) -> int:
        """Number of storeys."""
        return len(self.masses)

    @cached_property
    def elevations(self) -> np.ndarray:
        """Floor elevations above the common base (m), shape (n_storeys,)."""
        assert self.storey_heights is not None
        return np.cumsum(self.storey_heights)

    @cached_property
    def stiffness_matrix(self) -> np.ndarray:
        """K (kN/m), shape (n_storeys, n_storeys)."""
        k = np.asarray(self.stiffnesses, dtype=float)
        above = np.append(k[1:], 0.0)
        return np.diag(k + above) - np.diag(k[1:], 1) - np.diag(k[1:], -1)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Circular frequencies (rad/s), rising, and mass-normalised mode shapes (t^-1/2) in columns."""
        root = 1.0 / np.sqrt(np.asarray(self.masses, dtype=float))
        values, vectors = np.linalg.eigh(self.stiffness_matrix * np.outer(root, root))
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
    def rayleigh(self) -> tuple[float, float]:
        """Factors (a, b) of C = a M + b K (1/s, s), from the first two modes."""
        given = self.damping_ratio
        return rayleigh_factors(self.frequencies, given if isinstance(given, tuple) else (given, given))


def rayleigh_factors(frequencies: np.ndarray, ratios: tuple[float, float]) -> tuple[float, float]:
    """Factors (a, b) (1/s, s) of the Rayleigh damping C = a M + b K of given ratios in the first two modes (rad/s)."""
    if len(frequencies) == 1:  # a = 2 zeta w
        return 2.0 * ratios[0] * float(frequencies[0]), 0.0
    w1, w2 = float(frequencies[0]), float(frequencies[1])
    b = 2.0 * (ratios[1] * w2 - ratios[0] * w1) / (w2**2 - w1**2)
    return 2.0 * ratios[0] * w1 - b * w1**2, b


@dataclass(frozen=True)
class Wall:
    """A rigid wall (moat wall, barrier) at an end of the row; it moves with the ground.

    It meets every floor of its neighbour.
    """

    name: str = "wall"

    def __post_init__(self) -> None:
        _check_name("wall", self.name)


@dataclass(frozen=True)
class ContactProperties:
    """Reference contact properties of a scene.

    Parameters
    ----------
    linear_stiffness : float, optional
        For laws with force ~ d (kN/m).
    hertz_stiffness : float, optional
        For laws with force ~ d^1.5 (kN/m^1.5); see `pounding_sweep.hertz_stiffness`.
    restitution : float, optional
        Coefficient of restitution where a sweep gives none.
    """

    linear_stiffness: float | None = None
    hertz_stiffness: float | None = None
    restitution: float | None = None

    def __post_init__(self) -> None:
        for what, value in (("linear_stiffness", self.linear_stiffness), ("hertz_stiffness", self.hertz_stiffness)):
            if value is not None and not (isinstance(value, numbers.Real) and 0 < value < math.inf):
                msg = f"contact: {what} is {shown(value)}; it must be a positive number"
                raise SceneError(msg)
        if self.restitution is not None and not (
            isinstance(self.restitution, numbers.Real) and 0 <= self.restitution <= 1
        ):
            msg = f"contact: restitution is {self.restitution!r}; it must be in [0, 1]"
            raise SceneError(msg)

    def reference(self, exponent: float) -> float | None:
        """Return the reference stiffness (kN/m**exponent) for laws of that force exponent, or None."""
        return {1.0: self.linear_stiffness, 1.5: self.hertz_stiffness}.get(exponent)


@dataclass(frozen=True)
class Contact:
    """Two floors that can meet.

    Attributes
    ----------
    pair : int
        Index of the pair of neighbours.
    storey : int
        Storey label (1 at the bottom) in results: the left building's, or the
        right one's where the left neighbour is a wall.
    left, right : int
        Degree of freedom of the floor, numbered building by building; -1 for a wall.
    mass : float
        Effective mass m1 m2 / (m1 + m2) (t); the floor's own mass at a wall.
    """

    pair: int
    storey: int
    left: int
    right: int
    mass: float


@dataclass(frozen=True)
class Scene:
    """A row of buildings with a gap between each two neighbours.

    Parameters
    ----------
    row : sequence of Building or Wall
        From left to right. A `Wall` may be the first or the last.
    gaps : sequence of float
        Gap of each pair of neighbours (m), ``len(row) - 1`` of them.
    contact : ContactProperties, optional
        Reference contact stiffnesses and restitution.

    Raises
    ------
    SceneError
        No building, a wall inside the row, names that repeat, a wrong number of
        gaps or a gap below zero.

    Examples
    --------
    >>> a = Building("a", [100.0, 100.0], [1e5, 1e5])
    >>> b = Building("b", [80.0], [2e5])
    >>> scene = Scene([a, b, Wall()], gaps=[0.01, 0.02])
    >>> scene.pair_names
    ('a-b', 'b-wall')
    >>> [(c.pair, c.storey) for c in scene.contacts]
    [(0, 1), (1, 1)]
    """

    row: Sequence[Building | Wall]
    gaps: Sequence[float] = ()
    contact: ContactProperties = field(default_factory=ContactProperties)

    def __post_init__(self) -> None:
        if isinstance(self.row, (Building, Wall)) or not isinstance(self.row, Iterable):
            msg = f"a row is a list of Building and Wall objects, not {shown(self.row)}"
            raise SceneError(msg)
        row = tuple(self.row)
        if not isinstance(self.contact, ContactProperties):
            msg = f"contact must be ContactProperties, not {shown(self.contact)}"
            raise SceneError(msg)
        for item in row:
            if not isinstance(item, (Building, Wall)):
                msg = f"a row holds Building and Wall objects, not {shown(item)}"
                raise SceneError(msg)
        if not any(isinstance(item, Building) for item in row):
            msg = "a scene needs at least one building"
            raise SceneError(msg)
        for i, item in enumerate(row):
            if isinstance(item, Wall) and 0 < i < len(row) - 1:
                msg = f"wall {item.name!r} is number {i + 1} of the row; a wall may only be the first or the last"
                raise SceneError(msg)
        if len(row) > 1 and all(isinstance(row[i], Wall) for i in (0, -1)) and row[0].name == row[-1].name:
            row = (Wall(f"left {row[0].name}"), *row[1:-1], Wall(f"right {row[-1].name}"))
        names = [item.name for item in row]
        repeated = sorted({n for n in names if names.count(n) > 1})
        if repeated:
            msg = f"names must differ within a row; repeated: {', '.join(map(repr, repeated))}"
            raise SceneError(msg)
        object.__setattr__(self, "row", row)
        if len(set(self.pair_names)) < len(self.pair_names):
            msg = f"two pairs of the row have the same name ({', '.join(self.pair_names)}); rename a building"
            raise SceneError(msg)
        gaps = _numbers("gaps", "m", self.gaps)
        if len(gaps) != len(row) - 1:
            msg = f"{len(gaps)} gaps for a row of {len(row)}; give {len(row) - 1}, one between each two neighbours (m)"
            raise SceneError(msg)
        for name, gap in zip(self.pair_names, gaps, strict=True):
            check_gap(gap, f"gap of pair {name!r}")
        object.__setattr__(self, "gaps", gaps)

    @property
    def buildings(self) -> tuple[Building, ...]:
        """The buildings of the row, left to right, without walls."""
        return tuple(item for item in self.row if isinstance(item, Building))

    @property
    def pair_names(self) -> tuple[str, ...]:
        """Name of each pair of neighbours, ``"left-middle"``."""
        return tuple(f"{a.name}-{b.name}" for a, b in zip(self.row[:-1], self.row[1:], strict=True))

    @property
    def n_storeys(self) -> int:
        """Storeys of the highest building."""
        return max(b.n_storeys for b in self.buildings)

    @property
    def n_dof(self) -> int:
        """Number of floors of all buildings."""
        return sum(b.n_storeys for b in self.buildings)

    @cached_property
    def offsets(self) -> tuple[int, ...]:
        """First degree of freedom of each building, and the total at the end."""
        return tuple(int(i) for i in np.cumsum([0] + [b.n_storeys for b in self.buildings]))

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """All floors that can meet, pair by pair, bottom first."""
        first = 1 if isinstance(self.row[0], Wall) else 0
        found: list[Contact] = []
        for pair, (left, right) in enumerate(zip(self.row[:-1], self.row[1:], strict=True)):
            if isinstance(left, Building) and isinstance(right, Building):
                i, j = self.offsets[pair - first : pair - first + 2]
                for s, z in enumerate(left.elevations):
                    meets = np.flatnonzero(np.abs(right.elevations - z) <= FLOOR_TOLERANCE)
                    if meets.size:
                        t = int(meets[0])
                        m1, m2 = left.masses[s], right.masses[t]
                        found.append(Contact(pair, s + 1, i + s, j + t, m1 * m2 / (m1 + m2)))
            elif isinstance(left, Building):
                i = self.offsets[pair - first]
                found += [Contact(pair, s + 1, i + s, -1, m) for s, m in enumerate(left.masses)]
            elif isinstance(right, Building):
                found += [Contact(pair, s + 1, -1, s, m) for s, m in enumerate(right.masses)]
        return tuple(found)

    def _repr_html_(self) -> str:
        rows, gaps = [], [f"{1e3 * gap:.4g}" for gap in self.gaps] + [""]
        for item, gap in zip(self.row, gaps, strict=True):
            if isinstance(item, Wall):
                rows.append((item.name, "wall", "", "", gap))
            else:
                about = str(item.n_storeys), f"{sum(item.masses):.4g}", f"{item.periods[0]:.4g}"
                rows.append((item.name, *about, gap))
        return html_table(rows, ("", "storeys", "mass (t)", "first period (s)", "gap to the right (mm)"))

    def with_gaps(self, gaps: Sequence[float]) -> Scene:
        """Return the same row with other gaps (m)."""
        return Scene(self.row, gaps, self.contact)


def check_gap(gap: float, what: str = "gap") -> None:
    """Raise `SceneError` unless `gap` (m) is finite and not negative."""
    if not (math.isfinite(gap) and gap >= 0):
        msg = f"{what} is {gap!r} m; a gap must be zero or positive"
        raise SceneError(msg)
