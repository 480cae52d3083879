"""Reference solver, slow and obvious: one scenario at a time, adaptive steps, every event located.

Nothing here comes from the package under test. A row of shear buildings is integrated as one first-order system with
``scipy.integrate.DOP853``; the integrator is restarted at every record point and at every event, and between events
the phase of every contact (open, closed, rebounding, clipped) is frozen, so each piece that is integrated is smooth.

Units are kN, t, m, s. Displacements are relative to the ground. Penetration is ``d = u_left - u_right - gap``.

Conventions where a choice had to be made:

* ``v0`` is the rate of ``d`` at the located onset. Where a law divides by it, ``max(v0, 1e-3 m/s)`` is used;
  ``approach_speed_max`` reports it as it is.
* ``impact_force_max`` and ``penetration_max`` are largest positive values (0 where nothing touched).
* ``d`` has to exceed ``TOUCH`` (1e-13 m) to be seen as a touch, which keeps rounding noise of buildings that move
  alike from counting; the instant reported is still the one at which ``d`` left zero.
* ``stereomechanical``: velocities jump at the onset; ``impulse`` and ``contact_work`` take the jump. Impacts at one
  instant are taken pair by pair from the left and floor by floor from the bottom, until no floors approach; those of
  one contact are one onset. A rebound slower than ``REST`` is none. Floors that neither approach nor part, and are
  pressed together, stick: their accelerations are equal, by the force that follows (it counts in ``impulse``), until it
  would pull. Floors that stick again at a rate of less than ``COUNTED`` have no new onset, nor have floors that stick
  when struck, unless they rebound. ``impact_force_max`` and ``penetration_max`` mean nothing.
* A storey with a yield strength Vy has the shear ``V = k drift - (1 - hardening) k p``; its plastic drift p stands
  still while ``|drift - p| < Vy / k`` and follows the drift at that distance while it yields, until the drift turns.
* A storey of Bouc and Wen has the same shear; its plastic drift is a state, and flows at
  ``|z / dy|^n (gamma w + beta |w| sign z)``, w the rate of the drift, z = drift - p, dy = Vy / k.
* Other storeys have springs: objects with ``line()``, ``gauges(d, w)``, ``enter(phase, d)``, ``stored(d)``, ``slip(d)``
  and ``rest(d)``, straight lines between events; what they lose is the work of the storey less what they store.
* With ``p_delta`` every floor's weight m g stands on the storeys below it and, for each, does the work
  ``m g drift^2 / (2 h)`` as its storey leans (it goes down by h - sqrt(h^2 - drift^2)); stiffness matrix, modes and
  Rayleigh damping are those of storeys and weights. ``storey_shear_max`` is that of the storey alone. One that yields
  falls where its drift passes its height: there the run ends.
* A building on a foundation moves by its own displacements w on a base that sways by u and rocks by theta: floors by
  w + u + h theta. Its matrices are those of (w, u, theta), where masses are coupled, taken to the floors' displacements
  relative to the ground, the sway and the rocking of each base after all floors. C of the building acts on w alone.
* What a building gives to links is no part of its transfer, and has an integral of its own.
* Contacts with bumpers have a law, k and e of their own, and meet earlier by a thickness.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853, solve_ivp
from scipy.linalg import block_diag, eigh, expm
from scipy.optimize import brentq, nnls

WALL = "wall"
V0_FLOOR = 1e-3  # m/s, least approach speed a law may divide by
TOUCH = 1e-13  # m (or m/s), an event function must exceed this to have crossed zero
SAMPLES = 13  # points per integrator step at which events and peaks are looked for
MAX_EVENTS_PER_INTERVAL = 1000
REST = 1e-3  # m/s, rebound speed below which there is no rebound
SAME = 1e-6  # m/s, rate at which they neither approach nor part
COUNTED = 1e-4  # m/s, approach speed of the slowest touch that counts where velocities jump

OPEN, CLOSED, REBOUND, CLIPPED, YIELDING, SPENT = range(6)
FALLEN = 2.0  # of a storey


@dataclass
class ShearBuilding:
    masses: list[float]
    stiffnesses: list[float] | None
    damping_ratio: float = 0.05
    rayleigh: tuple[float, float] | None = None
    storey_heights: list[float] | None = None
    slab_depths: list[float] | None = None
    column_stiffnesses: list[float] | None = None  # 12 E I / L^3 of the columns that a slab strikes; the storeys' own
    yield_strengths: list[float] | None = None  # kN; infinite where a storey never yields
    hardening: float | list[float] = 0.0  # of all storeys, or of each
    tangent_damping: bool = False
    bouc_wen: tuple[float, float, float] | None = None  # n, beta, gamma of all storeys that yield
    springs: dict | None = None  # lists of springs, by storey from 0
    dashpots: list[float] | None = None  # kN s/m, between each floor and the one below
    p_delta: bool = False
    stiffness_matrix: list[list[float]] | None = None  # of floors, in place of `stiffnesses`
    # in place of Rayleigh damping: C of floors, or the damping ratio of all modes, or of each
    damping_matrix: list[list[float]] | None = None
    modal_damping: float | list[float] | None = None
    # m, I, K_h, K_theta, c_h, c_theta
    foundation: tuple[float, float, float, float, float, float] | None = None

    def on_base(self):
        """Return dense M, C, K and the ground's share of floors, sway and rocking of the base."""
        n, h = len(self.masses), self.elevations()
        mass, damping, stiffness = self.matrices()
        m, inertia, k_sway, k_rock, c_sway, c_rock = self.foundation
        coupled = np.zeros((n + 2, n + 2))
        coupled[:n, :n] = mass
        coupled[:n, n] = coupled[n, :n] = self.masses
        coupled[:n, n + 1] = coupled[n + 1, :n] = self.masses * h
        coupled[n, n] = np.sum(self.masses) + m
        coupled[n, n + 1] = coupled[n + 1, n] = np.sum(self.masses * h)
        coupled[n + 1, n + 1] = np.sum(self.masses * h**2) + inertia
        own = np.eye(n + 2)  # (w, u, theta) = (this) @ (w + u + h theta, u, theta)
        own[:n, n], own[:n, n + 1] = -1.0, -h
        load = own.T @ coupled[:, n]
        found = coupled, block_diag(damping, c_sway, c_rock), block_diag(stiffness, k_sway, k_rock)
        return *(own.T @ each @ own for each in found), load

    def leaning(self):
        """Return what the weights above take of each storey's stiffness (kN/m)."""
        n, heights = len(self.masses), np.diff(self.elevations(), prepend=0.0)
        if not self.p_delta:
            return np.zeros(n)
        return np.array([sum(9.81 * self.masses[j] / heights[i] for j in range(i, n)) for i in range(n)])

    def undamped(self):
        """Return dense M, K."""
        drift = np.eye(len(self.masses)) - np.eye(len(self.masses), k=-1)
        weights = drift.T @ np.diag(self.leaning()) @ drift
        return np.diag(np.asarray(self.masses, dtype=float)), self.of_floors() - weights

    def of_floors(self):
        """Return K (kN/m) of the floors on a fixed base, without weights."""
        if self.stiffness_matrix is not None:
            return np.array(self.stiffness_matrix)
        drift = np.eye(len(self.masses)) - np.eye(len(self.masses), k=-1)
        return drift.T @ np.diag(self.stiffnesses) @ drift

    def rayleigh_factors(self):
        """Return a and b of C = a M + b K (1/s, s)."""
        if self.rayleigh is not None:
            return self.rayleigh
        mass, stiffness = self.undamped()
        w, zeta = np.sqrt(eigh(stiffness, mass, eigvals_only=True)), self.damping_ratio
        if len(w) == 1:
            return 2 * zeta * w[0], 0.0
        return 2 * zeta * w[0] * w[1] / (w[0] + w[1]), 2 * zeta / (w[0] + w[1])

    def matrices(self):
        """Return dense M, C, K."""
        (mass, stiffness), (alpha, beta), n = self.undamped(), self.rayleigh_factors(), len(self.masses)
        drift = np.eye(n) - np.eye(n, k=-1)
        own = drift.T @ np.diag(np.zeros(n) if self.dashpots is None else self.dashpots) @ drift
        if self.damping_matrix is not None:
            return mass, self.damping_matrix + own, stiffness
        if self.modal_damping is not None:
            squares, shapes = eigh(stiffness, mass)
            ratios = np.broadcast_to(self.modal_damping, n)
            own = own + mass @ shapes @ np.diag(2.0 * ratios * np.sqrt(squares)) @ shapes.T @ mass
            return mass, own, stiffness
        return mass, alpha * mass + beta * stiffness + own, stiffness

    def elevations(self):
        heights = [3.0] * len(self.masses) if self.storey_heights is None else self.storey_heights
        return np.cumsum(heights)

    def slabs(self):
        """Return (bottom, top) of each slab."""
        depths = [0.0] * len(self.masses) if self.slab_depths is None else self.slab_depths
        return [(z - depth, z) for z, depth in zip(self.elevations(), depths, strict=True)]


# --------------------------------------------------------------------------------------------------------------------
# Contact laws: F = k d^n + (damper), with
#   "dashpot":       damper = 2 z sqrt(k m) v                       z: the damping ratio
#   "proportional":  damper = k d^n (D / v0) v                      D: dimensionless
#   "quarter":       damper = 2 z sqrt(k sqrt(d) m) v               z: the damping ratio
# A law with "yields" has no damper and a memory: see `Bilinear`; its z is the share of the energy that is lost.
# "approach": the damper acts while v > 0 only; "rebound": while v < 0 only. "clip": F = max(0, F) while d > 0.
# From the penetration "flat" on, k d^n goes on as a straight line of "stop" times its slope there.


def _zeta_kelvin_voigt(e):
    if e == 0.0:
        return 1.0
    return -np.log(e) / np.sqrt(np.pi**2 + np.log(e) ** 2)


@dataclass(frozen=True)
class Law:
    exponent: float
    damper: str | None = None
    approach_only: bool = False
    rebound_only: bool = False
    clip: bool = False
    yields: bool = False
    published: object = None  # e -> z or D
    flat: float = np.inf
    stop: float = 1.0


@dataclass(frozen=True)
class Bilinear:
    """Loading along k1 to the yield penetration, then along k2; unloading along k1 to the line k2 d, then along it."""

    k1: float
    k2: float
    dy: float

    def __init__(self, k, m, v0, lost, a=0.1):
        dm = (5 * m * v0**2 / (4 * k)) ** 0.4
        energy = k * dm**2.5 * lost / 2.5
        object.__setattr__(self, "k1", k * np.sqrt(dm) + energy / (a * dm**2))
        object.__setattr__(self, "k2", k * np.sqrt(dm) - energy / ((1 - a) * dm**2))
        object.__setattr__(self, "dy", a * dm)

    def force(self, phase, d, plastic):
        if phase == CLOSED:
            return self.k1 * d - (self.k1 - self.k2) * plastic
        return self.k2 * d + ((self.k1 - self.k2) * self.dy if phase == YIELDING else 0.0)

    def plastic(self, phase, d):
        """Plastic part of the penetration where a contact that slipped turns."""
        return d - self.dy if phase == YIELDING else d


LAWS = {
    "linear": Law(1.0),
    "hertz": Law(1.5),
    "kelvin_voigt": Law(1.0, "dashpot", clip=True, published=_zeta_kelvin_voigt),
    "kelvin_voigt_tension": Law(1.0, "dashpot", published=_zeta_kelvin_voigt),
    "linear_viscoelastic": Law(
        1.0, "dashpot", approach_only=True, published=lambda e: (1 - e * e) / (e * (e * (np.pi - 2) + 2))
    ),
    "modified_kelvin_voigt": Law(
        1.0, "proportional", approach_only=True, published=lambda e: 1.5 * (1 - e * e) / (e * e)
    ),
    "modified_kelvin": Law(1.0, "proportional", clip=True, published=lambda e: 1.5 * (1 - e) / e),
    "hertz_damped": Law(1.5, "proportional", clip=True, published=lambda e: 0.75 * (1 - e * e)),
    "hunt_crossley": Law(1.5, "proportional", clip=True, published=lambda e: 1.5 * (1 - e)),
    "ye_hertz": Law(1.5, "proportional", clip=True, published=lambda e: 1.6 * (1 - e) / e),
    "hysteretic": Law(1.5, yields=True, published=lambda e: 1 - e * e),
    "gonthier": Law(1.5, "proportional", clip=True, published=lambda e: (1 - e * e) / e),
    "nonlinear_viscoelastic": Law(
        1.5,
        "quarter",
        approach_only=True,
        published=lambda e: 4.5 * np.sqrt(5.0) * (1 - e * e) / (e * (e * (9 * np.pi - 16) + 16)),
    ),
}

NOMINAL = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95]
#: By the published damping, from converged independent integrations.
REALISED = {
    "kelvin_voigt_tension": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95],
    "kelvin_voigt": [0.253, 0.325, 0.397, 0.472, 0.550, 0.632, 0.718, 0.808, 0.902, 0.951],
    "modified_kelvin_voigt": [0.114, 0.224, 0.328, 0.428, 0.525, 0.620, 0.714, 0.807, 0.902, 0.951],
    "linear_viscoelastic": [0.102, 0.205, 0.307, 0.407, 0.506, 0.605, 0.703, 0.801, 0.900, 0.950],
    "modified_kelvin": [0.074, 0.166, 0.271, 0.380, 0.488, 0.594, 0.697, 0.799, 0.900, 0.950],
    "hertz_damped": [0.665, 0.672, 0.684, 0.702, 0.725, 0.756, 0.796, 0.847, 0.913, 0.954],
    "hunt_crossley": [0.516, 0.547, 0.581, 0.620, 0.663, 0.712, 0.768, 0.833, 0.909, 0.952],
    "ye_hertz": [0.069, 0.156, 0.256, 0.363, 0.470, 0.577, 0.683, 0.789, 0.894, 0.947],
    "gonthier": [0.101, 0.205, 0.304, 0.398, 0.488, 0.577, 0.670, 0.768, 0.876, 0.936],
    "hysteretic": [0.609, 0.619, 0.636, 0.660, 0.692, 0.734, 0.784, 0.845, 0.917, 0.957],
    "nonlinear_viscoelastic": [0.093, 0.191, 0.292, 0.393, 0.495, 0.596, 0.698, 0.799, 0.900, 0.950],
}


def rule_of(law):
    """The law of that name; one that is given stays as it is."""
    return law if isinstance(law, Law) else LAWS[law]


def damping_coefficient(law, e):
    """Published z or D of a law at nominal restitution e (None for an undamped law)."""
    rule = rule_of(law)
    return None if rule.published is None else float(rule.published(e))


def elastic_force(rule, k, d):
    d = np.maximum(d, 0.0)
    if rule.exponent in (1.0, 1.5):
        return k * d if rule.exponent == 1.0 else k * d * np.sqrt(d)
    n, flat = rule.exponent, rule.flat
    beyond = np.where(d > flat, rule.stop * n * k * min(flat, 1e9) ** (n - 1) * (d - flat), 0.0)
    return k * np.minimum(d, flat) ** n + beyond


def damper_force(rule, k, d, v, m, v0, z):
    d = np.maximum(d, 0.0)
    if rule.damper == "dashpot":
        return 2.0 * z * np.sqrt(k * m) * v
    if rule.damper == "proportional":
        return elastic_force(rule, k, d) * (z / v0) * v
    return 2.0 * z * np.sqrt(k * np.sqrt(d) * m) * v


# --------------------------------------------------------------------------------------------------------------------
# The row


def contact_floors(left, right):
    """Storeys (1 at the bottom) of two neighbours that meet: list of (left storey, right storey), None for a wall."""
    if isinstance(left, str):
        return [(None, j + 1) for j in range(len(right.masses))]
    if isinstance(right, str):
        return [(i + 1, None) for i in range(len(left.masses))]
    return [
        (i + 1, j + 1)
        for i, a in enumerate(left.slabs())
        for j, b in enumerate(right.slabs())
        if max(a[0], b[0]) - min(a[1], b[1]) <= 1e-3 * (1 + 1e-9)
    ]


def struck_columns(left, right):
    """Slabs of two neighbours that meet no slab but stand before columns of the other.

    List of (left storey, right storey, side whose columns are struck, xi): first slabs of the left building against
    columns of the right one, then the other way round; xi is where the middle of the slab is in the struck storey.
    """
    if isinstance(left, str) or isinstance(right, str):
        return []
    found = []
    for mine, other, side in ((left, right, 1), (right, left, 0)):
        level = [floors[1 - side] for floors in contact_floors(left, right)]
        below = np.concatenate([[0.0], other.elevations()])
        for i, (bottom, top) in enumerate(mine.slabs()):
            z = 0.5 * (bottom + top)
            for j in range(len(other.masses)):
                if i + 1 not in level and below[j] < z < below[j + 1]:
                    xi = (z - below[j]) / (below[j + 1] - below[j])
                    found.append((i + 1, j + 1, side, xi) if side else (j + 1, i + 1, side, xi))
    return found


def struck_beam(xi, stiffness):
    """A column with 12 E I / L^3 = stiffness, fixed against rotation at both ends, of two elements that join at xi L.

    Returns the displacement of that joint by a unit displacement of the lower and of the upper end, and by a unit
    force on it. By reciprocity the first two are the shares of such a force that the ends bear.
    """
    ei, k = stiffness / 12.0, np.zeros((6, 6))  # L = 1; displacement and rotation of each joint
    for first, h in ((0, xi), (2, 1.0 - xi)):
        k[first : first + 4, first : first + 4] += (ei / h**3) * np.array(
            [
                [12.0, 6.0 * h, -12.0, 6.0 * h],
                [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
                [-12.0, -6.0 * h, 12.0, -6.0 * h],
                [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
            ]
        )
    inner, ends = [2, 3], [0, 4]
    soft = np.linalg.inv(k[np.ix_(inner, inner)])
    lower, upper = -(soft @ k[np.ix_(inner, ends)])[0]
    return lower, upper, soft[0, 0]


class _Row:
    """Matrices of the whole row, the contact geometry, and the split of flat arrays by building and pair."""

    def __init__(self, buildings, gaps, columns=False, links=(), only=()):
        if len(gaps) != len(buildings) - 1:
            raise ValueError(f"{len(buildings)} neighbours need {len(buildings) - 1} gaps, not {len(gaps)}")
        sizes = [0 if isinstance(b, str) else len(b.masses) for b in buildings]
        self.start = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        self.floors = floors = int(self.start[-1])
        self.nb = len(buildings)
        real = [b for b in buildings if not isinstance(b, str)]
        based = [b for b in range(self.nb) if not isinstance(buildings[b], str) and buildings[b].foundation]
        self.n = n = floors + 2 * len(based)
        self.bases = [(b, floors + 2 * i) for i, b in enumerate(based)]
        mass, self.C, self.K, self.base = (np.zeros((n, n)) for _ in range(4))
        self.ground = np.ones(n)  # what of its acceleration each has
        self.drift = np.eye(floors, n)  # drift = (this) @ u
        for b, building in enumerate(buildings):
            if isinstance(building, str):
                continue
            mine = np.arange(self.start[b], self.start[b + 1])
            at, parts = mine, building.matrices()
            self.drift[mine[1:], mine[:-1]] = -1.0
            if b in based:
                sway = floors + 2 * based.index(b)
                at = np.array([*mine, sway, sway + 1])
                *parts, load = building.on_base()
                self.ground[at] = load / np.diag(parts[0])
                self.base[at[-2:], at[-2:]] = building.foundation[2:4]
                self.drift[mine[0], sway] = -1.0
                self.drift[mine, sway + 1] = -np.diff(building.elevations(), prepend=0.0)
            for whole, part in zip((mass, self.C, self.K), parts, strict=True):
                whole[np.ix_(at, at)] = part
        self.m = np.diag(mass)
        assert np.abs(mass - np.diag(self.m)).max() < 1e-9 * self.m.max()
        self.k_storey = np.concatenate([np.array(b.stiffnesses or [np.nan] * len(b.masses), dtype=float) for b in real])
        # shears of storeys without a stiffness of their own: forces of all floors above
        self.shear = np.zeros((floors, n))
        for b, building in enumerate(buildings):
            if not isinstance(building, str) and building.stiffness_matrix is not None:
                at = slice(self.start[b], self.start[b + 1])
                above = np.cumsum(building.of_floors()[::-1], axis=0)[::-1]
                self.shear[at] = above @ np.cumsum(self.drift[at], axis=0)

        self.leaning = np.concatenate([b.leaning() for b in real])
        self.limit = np.concatenate(
            [np.where(b.p_delta, np.diff(b.elevations(), prepend=0.0), np.inf) for b in real]
        )  # drift at which a storey falls

        self.softening = np.concatenate([np.full(len(b.masses), 1.0 - np.asarray(b.hardening)) for b in real])
        strengths = [[np.inf] * len(b.masses) if b.yield_strengths is None else b.yield_strengths for b in real]
        self.strength = np.concatenate(strengths).astype(float)
        self.yield_drift = np.where(np.isfinite(self.strength), self.strength, 0.0) / self.k_storey
        self.springs = {
            int(self.start[b]) + s: springs
            for b, building in enumerate(buildings)
            for s, springs in (getattr(building, "springs", None) or {}).items()
        }
        self.yields = bool(np.isfinite(self.strength).any() or self.springs)
        shapes = np.concatenate([np.full((len(b.masses), 3), b.bouc_wen or np.nan) for b in real])
        self.smooth = np.flatnonzero(np.isfinite(self.strength) & np.isfinite(shapes[:, 0]))
        self.flow = shapes[self.smooth].T
        # what the damper of a storey that yields loses of its coefficient (kN s/m)
        self.undamped = np.concatenate(
            [
                b.rayleigh_factors()[1] * np.multiply(1 - np.asarray(b.hardening), b.stiffnesses)
                if b.tangent_damping
                else np.zeros(len(b.masses))
                for b in real
            ]
        )

        self.owner = np.zeros((self.nb, n))  # sums storeys over each building
        for b in range(self.nb):
            self.owner[b, self.start[b] : self.start[b + 1]] = 1.0
        for b, sway in self.bases:
            self.owner[b, sway : sway + 2] = 1.0

        self.across = np.zeros((len(links), n))  # what a link stretches by = (this) @ u
        for i, (pair, left, right, _, _) in enumerate(links):
            self.across[i, self.start[pair] + left - 1] = 1.0
            self.across[i, self.start[pair + 1] + right - 1] = -1.0
        self.k_link, self.c_link = (np.array([link[i] for link in links]) for i in (3, 4))

        self.met = [contact_floors(buildings[p], buildings[p + 1]) for p in range(self.nb - 1)]
        if columns:
            self.met = [met + struck_columns(*buildings[p : p + 2]) for p, met in enumerate(self.met)]
        for p, storeys in dict(only).items():
            self.met[p] = [floors for floors in self.met[p] if (floors[0] or floors[1]) in storeys]
        rows, gap, self.softness, self.shares = [], [], [], []
        for p, floors in enumerate(self.met):
            for left, right, *struck in floors:
                row, soft, shares = np.zeros(n), 0.0, (np.nan, np.nan)
                for side, storey, sign in ((0, left, 1.0), (1, right, -1.0)):
                    if storey is None:
                        continue
                    i = self.start[p + side] + storey - 1
                    if struck and struck[0] == side:
                        own = buildings[p + side]
                        own = own.stiffnesses if own.column_stiffnesses is None else own.column_stiffnesses
                        *shares, soft = struck_beam(struck[1], own[storey - 1])
                        row[i] = sign * shares[1]
                        if storey > 1:
                            row[i - 1] = sign * shares[0]
                    else:
                        row[i] = sign
                rows.append(row)
                gap.append(float(gaps[p]))
                self.softness.append(soft)
                self.shares.append(shares)
        self.np = len(rows)
        meff = [1.0 / np.sum(row * row / self.m) for row in rows]
        self.B = np.array(rows).reshape(self.np, n)
        self.gap = np.array(gap)
        self.meff = np.array(meff)

    def standing(self, pair, storeys):
        """Numbers of the floors of a pair that meet at some storeys (None: all), columns left out."""
        every = [(p, floors) for p, met in enumerate(self.met) for floors in met]
        return [
            i
            for i, (p, (left, right, *struck)) in enumerate(every)
            if p == pair and not struck and (storeys is None or (left or right) in storeys)
        ]

    def place(self, floor):
        """Building of a floor, and its storey from 1."""
        b = int(np.searchsorted(self.start, floor, "right")) - 1
        return b, int(floor - self.start[b]) + 1

    def by_building(self, x):
        return [x[..., self.start[b] : self.start[b + 1]] for b in range(self.nb)]

    def by_pair(self, x):
        cuts = np.cumsum([len(f) for f in self.met])[:-1] if self.met else []
        return list(np.split(np.asarray(x), cuts)) if self.met else []


class _Solver:
    def __init__(self, row, law, k, e, damping, rtol, atol, bumpers):
        self.row = row
        self.jump = law == "stereomechanical"
        self.contact = row.np > 0 and law != "none"
        rule = None if law in ("none", "stereomechanical") else rule_of(law)
        self.k = (float(k) if k is not None else 0.0) / (1.0 + (k or 0.0) * np.array(row.softness))
        if rule is not None and rule.exponent != 1.0 and np.any(row.softness):
            raise ValueError(f"a spring like d^{rule.exponent} before a column is not one like it")
        self.e = e
        z = np.nan  # no damping
        if rule is not None and rule.published is not None:
            z = float(damping) if damping is not None else damping_coefficient(law, e)
        self.rules, self.z = [rule] * row.np, np.full(row.np, z)
        for pair, storeys, own, stiffness, restitution, _ in bumpers:
            for p in row.standing(pair, storeys):
                self.rules[p], self.k[p] = rule_of(own), stiffness
                number = damping_coefficient(own, restitution)
                self.z[p] = np.nan if number is None else number
        self.rtol = rtol
        n, nb, np_ = row.n, row.nb, row.np
        self.iu, self.iv = slice(0, n), slice(n, 2 * n)
        self.i_in, self.i_damp = slice(2 * n, 2 * n + nb), slice(2 * n + nb, 2 * n + 2 * nb)
        self.i_work = slice(2 * n + 2 * nb, 2 * n + 2 * nb + np_)
        self.i_imp = slice(2 * n + 2 * nb + np_, 2 * n + 2 * nb + 2 * np_)
        self.size = 2 * n + 2 * nb + 2 * np_
        self.i_hyst = slice(self.size, self.size + (nb if row.yields else 0))  # energies lost in yielding
        self.i_link = slice(self.i_hyst.stop, self.i_hyst.stop + (nb if len(row.across) else 0))  # given to links
        self.i_lost = slice(self.i_link.stop, self.i_link.stop + len(row.across))  # lost in their dashpots
        self.i_plastic = slice(self.i_lost.stop, self.i_lost.stop + len(row.smooth))  # of storeys of Bouc and Wen
        self.size = self.i_plastic.stop
        self.phase = np.zeros(row.floors)  # of each storey: 0 elastic, 1 or -1 yielding to that side
        self.slip = np.zeros(row.floors)  # its plastic drift, while elastic
        self.fallen = None  # when the first storey fell, and its number
        self.atol = np.full(self.size, float(atol))
        # energies and impulses: mass times velocities
        self.atol[2 * n : self.i_lost.stop] *= max(1.0, float(np.max(row.m)))
        self.state = np.zeros(np_, dtype=int)
        self.v0 = np.full(np_, V0_FLOOR)
        self.bilinear = [None] * np_
        self.plastic = np.zeros(np_)

        self.event_count = 0
        self.count = np.zeros(np_, dtype=int)
        self.first = [None] * np_
        self.closed = np.zeros(np_)  # time in contact
        self.approach = np.zeros(np_)
        self.last_open = np.zeros(np_)  # last instant seen with d <= 0
        self.peak = None

    # -- physics; u, v may have one column per instant -----------------------------------------------------------

    def force(self, d, v):
        """Contact force in the frozen phases."""
        found = np.zeros_like(d)
        if not self.contact or not self.state.any():
            return found
        for p, rule in enumerate(self.rules):
            if self.state[p] and rule.yields:
                found[p] = self.bilinear[p].force(self.state[p], d[p], self.plastic[p])
            elif self.state[p] in (CLOSED, REBOUND):
                found[p] = elastic_force(rule, self.k[p], d[p])
                if self.state[p] == CLOSED and not np.isnan(self.z[p]):
                    found[p] += damper_force(rule, self.k[p], d[p], v[p], self.row.meff[p], self.v0[p], self.z[p])
        return found

    def storeys(self, y, of_springs=False):
        """Return (drift, plastic drift, shear) of every storey in the frozen phases; plastic ones `of_springs` too."""
        row, column = self.row, (slice(None),) + (None,) * (y.ndim - 1)
        drift = row.drift @ y[self.iu]
        plastic = np.where(self.phase[column] == 0.0, self.slip[column], drift - (self.phase * row.yield_drift)[column])
        plastic[row.smooth] = y[self.i_plastic]
        shear = row.k_storey[column] * (drift - row.softening[column] * plastic)
        for i, springs in row.springs.items():
            if of_springs:
                plastic[i] = sum(spring.slip(drift[i]) for spring in springs)
            shear[i] = sum(spring.line()[0] * drift[i] + spring.line()[1] for spring in springs)
        return drift, plastic, np.where(np.isnan(row.k_storey)[column], row.shear @ y[self.iu], shear)

    def at_rest(self, y):
        """Drift of each storey under no shear: unloaded, and yielding back on the way where it must."""
        row = self.row
        rest = np.zeros(row.floors)
        plastic = self.storeys(y)[1]
        rest[row.smooth] = np.nan  # that go on flowing while they unload
        for i, springs in row.springs.items():
            rest[i] = springs[0].rest((row.drift @ y[self.iu])[i]) if len(springs) == 1 else np.nan
        for i in np.setdiff1d(np.flatnonzero(np.isfinite(row.strength)), [*row.smooth, *row.springs]):
            k, g = row.k_storey[i], row.leaning[i]
            soft, p, limit = row.softening[i] * k, abs(plastic[i]), row.strength[i] / k
            # no force is left where (k - g) d = soft p; if z = d - p is beyond yield there, it yields on
            d = soft * p / (k - g)
            if d - p < -limit:
                d = soft * limit / (k - soft - g)
            elif d - p > limit:
                d = np.nan  # without end
            rest[i] = d * np.sign(plastic[i])
        return rest

    def damping(self, v):
        """Return C v."""
        row, found = self.row, self.row.C @ v
        if row.undamped.any():
            column, share = (slice(None),) + (None,) * (v.ndim - 1), np.abs(self.phase)
            for i, springs in row.springs.items():
                kt = max(sum(spring.line()[0] for spring in springs), 0.0)
                share[i] = (1.0 - kt / row.k_storey[i]) / row.softening[i]
            found = found - row.drift.T @ ((row.undamped * share)[column] * (row.drift @ v))
        return found

    def pull(self, u, v):
        """Forces of links, which draw the floors together where they are positive."""
        row, column = self.row, (slice(None),) + (None,) * (u.ndim - 1)
        return row.k_link[column] * (row.across @ u) + row.c_link[column] * (row.across @ v)

    def motion(self, y, ag):
        """Return (acceleration relative to the ground, F, d, rate of d)."""
        row, u, v = self.row, y[self.iu], y[self.iv]
        m = row.m if u.ndim == 1 else row.m[:, None]
        ag = row.ground * ag if u.ndim == 1 else row.ground[:, None] * ag
        if row.yields:
            drift, _, shear = self.storeys(y)
            load = -self.damping(v) - row.drift.T @ (shear - (row.leaning * drift.T).T) - row.base @ u
        else:
            load = -self.damping(v) - row.K @ u
        if len(row.across):
            load = load - row.across.T @ self.pull(u, v)
        if not self.contact:
            zero = np.zeros((row.np, *u.shape[1:]))
            return load / m - ag, zero, zero - 1.0, zero
        d = row.B @ u
        d -= row.gap if u.ndim == 1 else row.gap[:, None]
        rate = row.B @ v
        f = self.holding(load / m - ag, self.state == CLOSED) if self.jump else self.force(d, rate)
        return (load - row.B.T @ f) / m - ag, f, d, rate

    def holding(self, x, which):
        """What the contacts `which` must give so that both floors of each have the same x (velocity, acceleration)."""
        f = np.zeros((self.row.np, *x.shape[1:]))
        if which.any():
            b = self.row.B[which]
            f[which] = np.linalg.solve(b @ (b / self.row.m).T, b @ x)
        return f

    def rhs(self, tau, y):
        row = self.row
        u, v = y[self.iu], y[self.iv]
        ag = self.ag0 + self.slope * tau
        a, f, _, rate = self.motion(y, ag)
        power_in = row.owner @ (-row.m * row.ground * ag * v)
        power_damp = row.owner @ (v * self.damping(v))
        rates = [v, a, power_in, power_damp, f * rate, f]
        if row.yields:  # of a storey that yields, z dp = Vy/k |d drift|
            with np.errstate(invalid="ignore"):
                power = np.where(self.phase != 0.0, row.softening * row.strength * self.phase * (row.drift @ v), 0.0)
            drift, plastic, shear = self.storeys(y)
            power[list(row.springs)] = (shear * (row.drift @ v))[list(row.springs)]
            z, w, (n, beta, gamma) = (drift - plastic)[row.smooth], (row.drift @ v)[row.smooth], row.flow
            flow = np.abs(z / row.yield_drift[row.smooth]) ** n * (gamma * w + beta * np.abs(w) * np.sign(z))
            power[row.smooth] = (row.softening * row.k_storey)[row.smooth] * z * flow
            rates.append(row.owner[:, : row.floors] @ power)
        if len(row.across):
            pull = self.pull(u, v)
            rates += [row.owner @ (v * (row.across.T @ pull)), row.c_link * (row.across @ v) ** 2]
        return np.concatenate([*rates, flow] if row.yields else rates)

    def energies(self, y):
        """Return (kinetic, strain, transfer) per building."""
        row = self.row
        u, v = y[self.iu], y[self.iv]
        m = row.m if y.ndim == 1 else row.m[:, None]
        kinetic = row.owner @ (0.5 * m * v * v)
        strain = row.owner @ (0.5 * u * (row.K @ u))
        if row.yields:
            drift, plastic, shear = self.storeys(y)
            k, soft, g = (x if y.ndim == 1 else x[:, None] for x in (row.k_storey, row.softening, row.leaning))
            springs = 0.5 * k * ((1.0 - soft) * drift**2 + soft * (drift - plastic) ** 2)
            springs = np.where(np.isnan(k), 0.5 * shear * drift, springs)
            for i, own in row.springs.items():
                springs[i] = sum(spring.stored(drift[i]) for spring in own)
            strain = row.owner[:, : row.floors] @ (springs - 0.5 * g * drift**2)
            strain += row.owner @ (0.5 * u * (row.base @ u))
        lost = self.hysteretic(y) if row.yields else 0.0
        lost = lost + (y[self.i_link] if len(row.across) else 0.0)
        return kinetic, strain, y[self.i_in] - kinetic - y[self.i_damp] - strain - lost

    def hysteretic(self, y):
        """Return what storeys of each building have lost."""
        found, drift = y[self.i_hyst].copy(), self.row.drift @ y[self.iu]
        for i, springs in self.row.springs.items():
            found[self.row.place(i)[0]] -= sum(spring.stored(drift[i]) for spring in springs)
        return found

    # -- events --------------------------------------------------------------------------------------------------

    def gauges(self, tau, y):
        """Event functions of the frozen phases: list of (pair, next phase, values); an event is a rise through 0."""
        row = self.row
        return (self.gauges_of_storeys(y) if row.yields else []) + (
            self.gauges_of_contacts(tau, y) if self.contact else []
        )

    def gauges_of_storeys(self, y):
        """Event functions of the storeys, numbered behind the pairs: next phase 1, -1 or 0."""
        row, out = self.row, []
        drift, rate = row.drift @ y[self.iu], row.drift @ y[self.iv]
        for i in sorted({*np.flatnonzero(np.isfinite(row.strength)), *row.springs}):
            if i in row.springs:
                out += [
                    (row.np + i, (spring, phase), values)
                    for spring in row.springs[i]
                    for phase, values in spring.gauges(drift[i], rate[i])
                ]
            elif i in row.smooth:
                pass
            elif self.phase[i] == 0.0:
                z, limit = drift[i] - self.slip[i], row.strength[i] / row.k_storey[i]
                out += [(row.np + i, 1.0, z - limit), (row.np + i, -1.0, -z - limit)]
            else:
                out.append((row.np + i, 0.0, -self.phase[i] * rate[i]))
            if np.isfinite(row.limit[i]):
                out.append((row.np + i, FALLEN, np.abs(drift[i]) - row.limit[i]))
        return out

    def gauges_of_contacts(self, tau, y):
        """Event functions of the contacts."""
        row = self.row
        d = row.B @ y[self.iu]
        d = d - (row.gap if y.ndim == 1 else row.gap[:, None])
        rate = row.B @ y[self.iv]
        if self.jump:
            f = self.motion(y, self.ag0 + self.slope * np.asarray(tau))[1]
            stuck = self.state == CLOSED
            return [(p, OPEN, -f[p] / row.meff[p]) if stuck[p] else (p, CLOSED, d[p]) for p in range(row.np)]
        out = []
        for p, rule in enumerate(self.rules):
            now, z = self.state[p], self.z[p]
            if now == OPEN:
                out.append((p, REBOUND if rule.rebound_only else CLOSED, d[p]))
                continue
            out.append((p, OPEN, -d[p]))
            if rule.yields:
                if now == CLOSED and z > 0.0:
                    out.append((p, YIELDING, d[p] - self.plastic[p] - self.bilinear[p].dy))
                    if self.plastic[p] > 0.0:
                        out.append((p, SPENT, self.plastic[p] - d[p]))
                elif now != CLOSED:
                    out.append((p, CLOSED, -rate[p] if now == YIELDING else rate[p]))
                continue
            if np.isnan(z) or z == 0.0:
                continue
            if rule.approach_only:
                out.append((p, REBOUND, -rate[p]) if now == CLOSED else (p, CLOSED, rate[p]))
            elif rule.rebound_only:  # of which REBOUND is the approach, without damper
                pulls = -(rate[p] + self.v0[p] / z)
                if now == REBOUND:
                    out.append((p, CLOSED, -rate[p]))
                else:
                    out += [(p, REBOUND, rate[p]), (p, CLIPPED, pulls)] if now == CLOSED else [(p, CLOSED, -pulls)]
            elif rule.clip:
                # Sign of the published force: d + (c/k) v, or 1 + (D/v0) v scaled to a speed.
                if rule.damper == "dashpot":
                    sign = d[p] + 2.0 * z * np.sqrt(row.meff[p] / self.k[p]) * rate[p]
                else:
                    sign = rate[p] + self.v0[p] / z
                out.append((p, CLIPPED, -sign) if now == CLOSED else (p, CLOSED, sign))
        return out

    def find_event(self, dense, ts, ys):
        """Earliest event in a step: (time, pair, next phase, located by a root?) or None."""
        best = None
        for g, (p, target, values) in enumerate(self.gauges(ts, ys)):

            def gauge(t, g=g):
                return float(self.gauges(t, dense(t))[g][2])

            above = np.flatnonzero(values > TOUCH)
            stop = int(above[0]) if above.size else len(ts)
            bracket = None
            # A hump between samples that all lie below zero (a grazing touch).
            for i in range(min(stop, len(ts))):
                a, b = max(i - 1, 0), min(i + 1, len(ts) - 1)
                left, mid, right = values[a], values[i], values[b]
                if left < 0.0 and mid < 0.0 and mid >= left and mid >= right and 3.0 * mid - left - right > 0.0:
                    top, value = _zoom(lambda t, g=g: self.gauges(t, dense(t))[g][2], ts[a], ts[b])
                    if value > TOUCH:
                        bracket = (ts[a], top)
                        break
            if bracket is None:
                if stop == len(ts):
                    continue
                if stop == 0 or values[stop - 1] >= 0.0:
                    t_event = ts[max(stop - 1, 0)]
                else:
                    bracket = (ts[stop - 1], ts[stop])
            located = bracket is not None
            if located:
                t_event = brentq(gauge, *bracket, xtol=1e-17, rtol=1e-15)
            if best is None or t_event < best[0]:
                best = (t_event, p, target, located)
        return best

    def enter(self, t_global, y, p, target, located):
        """Set the phase of a pair after an event; returns the state vector (changed only if stereomechanical)."""
        self.event_count += 1
        if p >= self.row.np:
            i = p - self.row.np
            if target == FALLEN:
                self.fallen = t_global, i
                return y
            if isinstance(target, tuple):
                target[0].enter(target[1], (self.row.drift @ y[self.iu])[i])
                return y
            if target == 0.0:  # the drift turns
                self.slip[i] = self.storeys(y)[1][i]
            self.phase[i] = target
            return y
        if self.jump:
            at = self.state == CLOSED
            at[p] = target == CLOSED
            y = y.copy()
            # just open: a bounce may be over by the next sample
            miss = self.row.B[p] @ y[self.iu] - self.row.gap[p] + 0.01 * TOUCH
            y[self.iu] -= self.row.B[p] / self.row.m * self.row.meff[p] * miss
            self.state[p] = OPEN
            return self.collide(t_global, t_global if located else min(t_global, self.last_open[p]), y, at)
        if self.state[p] == OPEN:
            v = max(float(self.row.B[p] @ y[self.iv]), 0.0)
            self.v0[p] = max(v, V0_FLOOR)
            self.count[p] += 1
            self.approach[p] = max(self.approach[p], v)
            if self.first[p] is None:
                self.first[p] = float(t_global if located else min(t_global, self.last_open[p]))
            if self.rules[p].yields:
                self.bilinear[p], self.plastic[p] = Bilinear(self.k[p], self.row.meff[p], self.v0[p], self.z[p]), 0.0
        elif self.state[p] in (YIELDING, SPENT) and target == CLOSED:
            d = float(self.row.B[p] @ y[self.iu]) - self.row.gap[p]
            self.plastic[p] = self.bilinear[p].plastic(self.state[p], d)
        self.state[p] = target
        return y

    def collide(self, t, touched, y, at):
        """Velocity jumps of the contacts `at` this instant, and which of them stick from now on."""
        row, rested, counted = self.row, self.state == CLOSED, np.zeros(self.row.np, dtype=bool)

        def onset(p, v):
            if not counted[p] and (v > COUNTED or not self.count[p]):
                self.count[p] += 1
            counted[p] = True
            self.approach[p] = max(self.approach[p], v)
            self.first[p] = float(touched) if self.first[p] is None else self.first[p]

        meeting = True
        while meeting:
            meeting = False
            for p in np.flatnonzero(at):
                v = row.B[p] @ y[self.iv]
                if v <= SAME:
                    continue
                meeting = True
                e = self.e if self.e * v > REST else 0.0
                if e > 0.0 or not rested[p]:
                    onset(p, v)
                impulse = (1.0 + e) * row.meff[p] * v
                y[self.iv] -= row.B[p] / row.m * impulse
                y[self.i_imp][p] += impulse
                y[self.i_work][p] += 0.5 * impulse * v * (1.0 - e)
                transfer = self.energies(y)[2]
                self.peak[-2 * row.nb :] = np.maximum(self.peak[-2 * row.nb :], np.concatenate([transfer, -transfer]))
        rate = row.B @ y[self.iv]
        still = at & (rate >= -SAME)
        impulse = self.holding(y[self.iv], still)
        y[self.iv] -= row.B.T @ impulse / row.m
        y[self.i_imp] += impulse
        y[self.i_work] += 0.5 * impulse * rate
        stick = self.sticking(t, y, still)
        for p in np.flatnonzero(stick & ~rested):
            onset(p, max(rate[p], 0.0))
        self.state = np.where(stick, CLOSED, OPEN)
        return y

    def sticking(self, t, y, may):
        """Which of the contacts that `may` stick are pressed, by the forces >= 0 of least constraint (Gauss)."""
        row, stick = self.row, np.zeros(self.row.np, dtype=bool)
        if may.any():
            known, self.state = self.state, np.zeros(row.np, dtype=int)
            a = self.motion(y, self.ag0 + self.slope * (t - self.t_start))[0]
            self.state = known
            b = row.B[may]
            f = nnls((b / np.sqrt(row.m)).T, np.sqrt(row.m) * a)[0]
            stick[may] = (f > 0.0) | (b @ (a - b.T @ f / row.m) > -1e-9)
        return stick

    # -- peaks ---------------------------------------------------------------------------------------------------

    def observe(self, tau, y):
        """Every quantity whose largest value is wanted, one row each."""
        row, u, v = self.row, y[self.iu], y[self.iv]
        ag = self.ag0 + self.slope * tau
        a, f, d, _ = self.motion(y, ag)
        transfer = self.energies(y)[2]
        drift, _, shear = self.storeys(y)
        total = np.abs(a + row.ground.reshape(-1, *[1] * (u.ndim - 1)) * ag)
        return np.concatenate(
            [u, -u, np.abs(drift), total, f, d, np.abs(shear), self.spread(u, v), transfer, -transfer]
        )

    def spread(self, u, v):
        """Sizes of the forces of links, by the left floors that they hold."""
        found = np.zeros_like(u)
        for row, force in zip(self.row.across, self.pull(u, v), strict=True):
            found[int(np.argmax(row))] = np.abs(force)
        return found

    def note_peaks(self, dense, ts, ys):
        q = self.observe(ts, ys)
        top = np.argmax(q, axis=1)
        rows = np.arange(len(q))
        value = q[rows, top]
        lower, upper = np.maximum(top - 1, 0), np.minimum(top + 1, len(ts) - 1)
        reach = 0.5 * np.maximum(value - q[rows, lower], value - q[rows, upper])
        # what still rises at the end, by the slope of a parabola there, has its largest value in the steps to come
        rising = (top == len(ts) - 1) & (2.0 * (value - q[:, -2]) > q[:, -2] - q[:, -3])
        candidates = np.flatnonzero(~rising & (value + reach > self.peak) & (reach > 1e-10 * np.abs(value)))
        self.peak = np.maximum(self.peak, value)
        if candidates.size:
            tops = self.tops(dense, candidates, ts[lower[candidates]], ts[upper[candidates]])
            self.peak[candidates] = np.maximum(self.peak[candidates], tops)

    def tops(self, dense, which, lo, hi, points=21, rounds=4):
        """Largest value of each of these quantities on its own span, by repeated sampling around the best sample."""
        each, best = np.arange(len(which)), np.full(len(which), -np.inf)
        for _ in range(rounds):
            t = np.linspace(lo, hi, points)
            values = self.observe(t.ravel(), dense(t.ravel())).reshape(-1, *t.shape)[which, :, each]
            i = np.argmax(values, axis=1)
            best = np.maximum(best, values[each, i])
            lo, hi = t[np.maximum(i - 1, 0), each], t[np.minimum(i + 1, points - 1), each]
        return best

    # -- time ----------------------------------------------------------------------------------------------------

    def interval(self, y, t_start, dt, ag0, ag1):
        """Integrate one record interval in local time, restarting at events."""
        self.ag0, self.slope, self.t_start = ag0, (ag1 - ag0) / dt, t_start
        tau, events_here = 0.0, 0
        solver = None
        while tau < dt:
            if solver is None:
                first = None if self.h_next is None else min(self.h_next, dt - tau)
                solver = DOP853(self.rhs, tau, y, dt, rtol=self.rtol, atol=self.atol, first_step=first)
            message = solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"integration failed at t = {t_start + solver.t}: {message}")
            dense = solver.dense_output()
            ts = np.linspace(tau, solver.t, SAMPLES)
            ys = dense(ts)
            event = self.find_event(dense, ts, ys) if self.contact or self.row.yields else None
            end = solver.t if event is None else event[0]
            if event is not None:
                ts = np.linspace(tau, end, SAMPLES)
                ys = dense(ts)
            if end > tau:
                self.note_peaks(dense, ts, ys)
                self.closed[self.state != OPEN] += end - tau
            if self.contact:
                d = self.row.B @ ys[self.iu] - self.row.gap[:, None]
                for p in np.flatnonzero((d <= 0.0).any(axis=1)):
                    self.last_open[p] = t_start + ts[np.flatnonzero(d[p] <= 0.0)[-1]]
            if event is None:
                tau, y, self.h_next = solver.t, solver.y, solver.h_abs
                continue
            events_here += 1
            if events_here > MAX_EVENTS_PER_INTERVAL:
                raise RuntimeError(
                    f"more than {MAX_EVENTS_PER_INTERVAL} events in one record interval at t = {t_start + tau}"
                )
            y = ys[:, 0].copy() if end == tau else dense(end)
            tau = end
            y = self.enter(t_start + tau, y, *event[1:])
            if self.fallen is not None:
                return y
            self.h_next, solver = None, None
            # The limit just after the event: force and acceleration may have jumped.
            self.peak = np.maximum(self.peak, self.observe_now(tau, y))
        return y

    def observe_now(self, tau, y):
        return self.observe(np.array([tau]), y[:, None])[:, 0]


def _zoom(f, a, b, points=21, rounds=5):
    """Largest value of a vectorised smooth f on [a, b] by repeated sampling around the best sample."""
    lo, hi = a, b
    best_t, best = a, -np.inf
    for _ in range(rounds):
        t = np.linspace(lo, hi, points)
        values = f(t)
        i = int(np.argmax(values))
        if values[i] > best:
            best_t, best = float(t[i]), float(values[i])
        lo, hi = t[max(i - 1, 0)], t[min(i + 1, points - 1)]
    return best_t, best


def run(
    buildings,
    gaps,
    ag,
    dt,
    law,
    k=None,
    e=None,
    *,
    columns=False,
    links=(),
    only=(),
    bumpers=(),
    damping=None,
    rest=0.0,
    rtol=1e-10,
    atol=1e-12,
):
    """Response of a row to one ground motion.

    Parameters
    ----------
    buildings : list of ShearBuilding or WALL; gaps : list of float, m, one fewer.
    ag, dt : ground acceleration at the record points, m/s2, linear in between; the run covers all of it.
    law : key of LAWS, or "none", or "stereomechanical". k : kN/m or kN/m^1.5. e : nominal restitution.
    columns : slabs strike columns too, see `struck_columns`; the stiffness k and that of the column are in series.
    only : storeys by pair, the left building's (the right one's behind a wall), at which alone it meets.
    links : list of (pair, left storey, right storey, stiffness in kN/m, damping in kN s/m) between neighbours.
    bumpers : list of (pair, storeys as in `only` or None for all, law, k, e, thickness in m) of contacts of their own.
    damping : replaces the published z (dashpot and quarter laws) or D = coefficient * v0 (proportional laws).
    rest : time after the record, s, over which the ground comes to rest within dt and stays there; kinetic_final and
        strain_final are those before it, and energy_damping takes what is left after it of a row that is all elastic.

    Returns
    -------
    dict. Per building lists of arrays over storeys: displacement_max, displacement_min, drift_max, storey_shear_max,
    acceleration_max, and displacement (record points x storeys).
    Per building arrays: energy_input, energy_damping, kinetic_final, strain_final, energy_transfer_max,
    energy_transfer_min (a wall has zeros), and of storeys that may yield ductility_max, plastic_drift_final,
    residual_drift (per storey) and energy_hysteretic (per building); of links link_force (per storey of their left
    floors), energy_links (per building), energy_of_links (kept or lost). foundation: largest sway and rotation.
    Per pair lists over the floors
    that meet: floors (storeys left and right, None at a wall; see `struck_columns` for columns), column_shear_max
    (largest shears by the contact below and above the struck point, NaN between floors), impact_force_max,
    impact_count, penetration_max, impulse, first_impact_time (None: no impact), approach_speed_max, contact_time,
    contact_work. event_count. fallen: None, or time and (building, storey from 1) of the first fall.
    """
    row = _Row(buildings, gaps, columns, links, only)
    ag = np.asarray(ag, dtype=float)
    for pair, storeys, *_, thickness in bumpers:
        row.gap[row.standing(pair, storeys)] -= thickness
    s = _Solver(row, law, k, e, damping, rtol, atol, bumpers)
    y = np.zeros(s.size)
    s.h_next = None
    s.ag0, s.slope, s.t_start = ag[0], 0.0, 0.0
    if s.contact and np.any(row.gap < 0.0):
        raise ValueError("gaps must not be negative")
    s.peak = np.maximum(0.0, s.observe_now(0.0, y))
    history = [y[: row.n].copy()]
    points, ag = len(ag), np.append(ag, np.zeros(int(np.ceil(rest / dt - 1e-9))))
    for i in range(len(ag) - 1):
        if i == points - 1:
            kinetic, strain, _ = s.energies(y)
        y = s.interval(y, i * dt, dt, ag[i], ag[i + 1])
        if s.fallen is not None:
            break
        history.append(y[: row.n].copy())
    *left, _ = s.energies(y)
    if len(ag) == points:
        kinetic, strain = left
    lost = y[s.i_damp] + (sum(left) if len(ag) > points and not row.yields else 0.0)

    n, np_, nb = row.n, row.np, row.nb
    cuts = np.cumsum([n, n, row.floors, n, np_, np_, row.floors, n, nb])
    up, down, drift, acc, force, pen, shear, pull, tr_max, tr_min = np.split(s.peak, cuts)
    first = iter(s.first)
    levels = [np.zeros(0) if isinstance(b, str) else b.elevations() for b in buildings]
    return {
        "floors": row.met,
        "displacement_max": row.by_building(up),
        "displacement_min": row.by_building(-down),
        "drift_max": row.by_building(drift),
        "drift_ratio_max": row.by_building(drift / np.concatenate([np.diff(z, prepend=0.0) for z in levels])),
        "roof_drift_ratio_max": np.array(
            [
                u[-1] / z[-1] if len(z) else 0.0
                for u, z in zip(row.by_building(np.maximum(up, down)), levels, strict=True)
            ]
        ),
        "storey_shear_max": row.by_building(shear),
        "acceleration_max": row.by_building(acc),
        "impact_force_max": row.by_pair(force),
        "column_shear_max": row.by_pair(force[:, None] * np.reshape(row.shares, (-1, 2))),
        "impact_count": row.by_pair(s.count),
        "penetration_max": row.by_pair(pen),
        "impulse": row.by_pair(y[s.i_imp]),
        "first_impact_time": [[next(first) for _ in floors] for floors in row.met],
        "approach_speed_max": row.by_pair(s.approach),
        "contact_time": row.by_pair(s.closed),
        "contact_work": row.by_pair(y[s.i_work]),
        "energy_input": y[s.i_in].copy(),
        "energy_damping": lost,
        "kinetic_final": kinetic,
        "strain_final": strain,
        "energy_hysteretic": s.hysteretic(y) if row.yields else np.zeros(nb),
        "link_force": row.by_building(pull),
        "energy_links": y[s.i_link].copy() if len(row.across) else np.zeros(nb),
        "energy_of_links": float(np.sum(y[s.i_lost]) + 0.5 * np.sum(row.k_link * (row.across @ y[s.iu]) ** 2)),
        "plastic_drift_final": row.by_building(s.storeys(y, of_springs=True)[1]),
        "ductility_max": row.by_building(
            drift * row.k_storey / np.where(np.isfinite(row.strength), row.strength, np.nan)
        ),
        "residual_drift": row.by_building(s.at_rest(y)),
        "foundation": {b: np.maximum(up, down)[sway : sway + 2] for b, sway in row.bases},
        "energy_transfer_max": tr_max,
        "energy_transfer_min": -tr_min,
        "displacement": row.by_building(np.array(history)),
        "fallen": None if s.fallen is None else (s.fallen[0], *row.place(s.fallen[1])),
        "event_count": s.event_count,
    }


# --------------------------------------------------------------------------------------------------------------------
# Small exact or near-exact references


def two_mass_impact(law, k, e, m1, m2, v0, *, damping=None, rtol=1e-12):
    """Two free masses that meet at v0: m d'' = -F(d, d'), integrated to separation.

    Returns restitution, duration (to d = 0, or to F = 0 for a clipped dashpot), penetration_max, force_max,
    energy_lost.
    """
    rule = rule_of(law)
    m = m1 * m2 / (m1 + m2)
    if rule.yields:
        return _two_mass_bilinear(
            Bilinear(k, m, v0, damping_coefficient(law, e) if damping is None else damping), m, v0
        )
    z = 0.0
    if rule.damper is not None:
        z = damping_coefficient(law, e) if damping is None else damping
    scale_t = np.sqrt(m / k) if rule.exponent == 1.0 else (m * m / (k * k * v0)) ** 0.2
    scale_d = v0 * scale_t

    def force(d, v, damped=True):
        f = elastic_force(rule, k, d)
        if rule.damper is not None and damped:
            f = f + damper_force(rule, k, d, v, m, max(v0, V0_FLOOR), z)
        return f

    def approach(_, y):
        return [y[1], -force(y[0], y[1]) / m]

    def rebound(_, y):
        return [y[1], -force(y[0], y[1], damped=not rule.approach_only) / m]

    def stopped(_, y):
        return y[1]

    def separated(t, y):
        if rule.clip and rule.damper == "dashpot":
            return force(y[0], y[1]) / (k * scale_d)
        return y[0] / scale_d

    stopped.terminal, stopped.direction = True, -1
    separated.terminal, separated.direction = True, -1
    tolerance = {"method": "DOP853", "rtol": rtol, "atol": [1e-14 * scale_d, 1e-14 * v0], "dense_output": True}
    first = solve_ivp(approach, (0.0, 1e3 * scale_t), [0.0, v0], events=stopped, **tolerance)
    t_stop, y_stop = first.t_events[0][0], first.y_events[0][0]
    second = solve_ivp(rebound, (t_stop, t_stop + 1e4 * scale_t), [y_stop[0], 0.0], events=separated, **tolerance)
    t_end, y_end = second.t_events[0][0], second.y_events[0][0]
    t = np.linspace(0.0, t_stop, 4001)
    y = first.sol(t)
    f = force(y[0], y[1])
    i = int(np.argmax(f))
    a, b = t[max(i - 1, 0)], t[min(i + 1, len(t) - 1)]
    peak = max(force(0.0, v0), _zoom(lambda s: force(*first.sol(s)), a, b)[1], force(y_stop[0], 0.0))
    restitution = -y_end[1] / v0
    return {
        "restitution": float(restitution),
        "duration": float(t_end),
        "penetration_max": float(y_stop[0]),
        "force_max": float(peak),
        "energy_lost": float(0.5 * m * v0 * v0 * (1.0 - restitution**2)),
    }


def _two_mass_bilinear(spring, m, v0, rtol=1e-12):
    """As two_mass_impact: piece by piece, each ending where the force changes its line."""

    def piece(phase, t, y, plastic, left):
        """Integrate until what is left, of d and v, is nothing."""

        def rhs(_, y):
            return [y[1], -spring.force(phase, y[0], plastic) / m]

        def stop(_, y):
            return left(*y)

        stop.terminal, stop.direction = True, -1
        tolerance = {"method": "DOP853", "rtol": rtol, "atol": [1e-16 * spring.dy, 1e-14 * v0]}
        found = solve_ivp(rhs, (t, t + 1e3 * spring.dy / v0), y, events=stop, **tolerance)
        return found.t_events[0][0], found.y_events[0][0]

    t, y = piece(CLOSED, 0.0, [0.0, v0], 0.0, lambda d, _: spring.dy - d)
    t, y = piece(YIELDING, t, y, 0.0, lambda _, v: v)
    top, plastic = y[0], spring.plastic(YIELDING, y[0])
    t, y = piece(CLOSED, t, y, plastic, lambda d, _: d - plastic)
    t, y = piece(SPENT, t, y, plastic, lambda d, _: d)
    e = -y[1] / v0
    return {
        "restitution": float(e),
        "duration": float(t),
        "penetration_max": float(top),
        "force_max": float(spring.force(YIELDING, top, 0.0)),
        "energy_lost": float(0.5 * m * v0 * v0 * (1.0 - e * e)),
    }


def two_mass_restitution(law, k, e, m1, m2, v0, *, damping=None):
    """Realised restitution of two free masses (see two_mass_impact)."""
    return two_mass_impact(law, k, e, m1, m2, v0, damping=damping)["restitution"]


def modal_exact(building, ag, dt, *, velocity=None):
    """Linear response at the record points (points x storeys), exact: expm of the state with ag and its slope."""
    mass, damping, stiffness = building.matrices()
    n = len(mass)
    a = np.zeros((2 * n + 2, 2 * n + 2))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, :n] = -np.linalg.solve(mass, stiffness)
    a[n : 2 * n, n : 2 * n] = -np.linalg.solve(mass, damping)
    a[n : 2 * n, 2 * n] = -1.0
    a[2 * n, 2 * n + 1] = 1.0
    step = expm(a * dt)
    x = np.zeros(2 * n)
    if velocity is not None:
        x[n:] = velocity
    out = [x]
    for a0, a1 in pairwise(ag):
        x = (step @ np.concatenate([x, [a0, (a1 - a0) / dt]]))[: 2 * n]
        out.append(x)
    out = np.array(out)
    return out[:, :n], out[:, n:]
