"""The work that every tool is given: the paper's row under El Centro, one contact law, a range of gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import pounding_sweep as ps
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record

#: Gaps (m) of the sweeps that are timed: neighbours stand side by side in lanes, as they do in any sweep over gaps.
GAPS = (0.004, 0.020)
#: Gaps (m) at which errors are measured, for every tool alike.
ERROR_GAPS = np.array([0.006, 0.010, 0.014, 0.018])
#: Part of the record (s) that the short form uses.
SHORT_SECONDS = 5.0


@dataclass(frozen=True)
class Work:
    """One row, record and law."""

    scene: Scene  # the row (kN, t, m)
    record: Record  # ground motion (m/s2)
    law: str  # contact law
    stiffness: float  # contact stiffness (kN/m**exponent)
    restitution: float  # coefficient of restitution, for laws that take one

    @cached_property
    def row(self) -> Row:
        """The scene as arrays over floors and contacts."""
        return Row.of(self.scene)

    @property
    def exponent(self) -> float:
        """Power of the penetration in the elastic force."""
        return float(ps.get_law(self.law).exponent or 1.0)

    def under(self, law: str) -> Work:
        """Return the same work under another law, at the scene's reference stiffness for it."""
        exponent = ps.get_law(law).exponent or 1.0
        return replace(self, law=law, stiffness=float(self.scene.contact.reference(exponent) or 0.0))


@dataclass(frozen=True)
class Row:
    """A row of shear buildings as arrays over its floors, building by building, and over its contacts."""

    #: mass (t), storey stiffness (kN/m) and Rayleigh damping of each floor, shape (n,)
    mass: np.ndarray
    stiffness: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    #: whether a floor is the lowest, or the roof, of its building, shape (n,)
    bottom: np.ndarray
    top: np.ndarray
    #: floors that meet, shape (contacts,)
    left: np.ndarray
    right: np.ndarray
    reduced: np.ndarray  # reduced mass (t) of the two, shape (contacts,)

    @classmethod
    def of(cls, scene: Scene) -> Row:
        """Return the arrays of a row without walls."""
        buildings = scene.buildings
        sizes = [b.n_storeys for b in buildings]
        return cls(
            mass=np.concatenate([b.masses for b in buildings]),
            stiffness=np.concatenate([b.storey_stiffnesses for b in buildings]),
            alpha=np.repeat([b.rayleigh[0] for b in buildings], sizes),
            beta=np.repeat([b.rayleigh[1] for b in buildings], sizes),
            bottom=np.concatenate([np.arange(n) == 0 for n in sizes]),
            top=np.concatenate([np.arange(n) == n - 1 for n in sizes]),
            left=np.array([c.left for c in scene.contacts]),
            right=np.array([c.right for c in scene.contacts]),
            reduced=np.array([c.mass for c in scene.contacts]),
        )

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Damping and stiffness matrices (n, n) of the whole row."""
        n = len(self.mass)
        drift = np.eye(n) - np.eye(n, k=-1) * ~self.bottom[:, None]
        stiffness = drift.T @ (self.stiffness[:, None] * drift)
        damping = drift.T @ ((self.beta * self.stiffness)[:, None] * drift)
        return np.diag(self.alpha * self.mass) + damping, stiffness


@dataclass(frozen=True)
class Peaks:
    """What every tool must report of n scenarios."""

    #: peak impact force (kN) and number of impacts of each contact, shape (n, contacts)
    force: np.ndarray
    onsets: np.ndarray
    #: largest and smallest displacement (m) of each floor relative to the ground, shape (n, floors)
    highest: np.ndarray
    lowest: np.ndarray

    @classmethod
    def stack(cls, parts: list[Peaks]) -> Peaks:
        """Join the results of several calls."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in cls.__dataclass_fields__))


def cut(record: Record, seconds: float) -> Record:
    """Return the first `seconds` (s) of a record."""
    points = round(seconds / record.dt) + 1
    return Record(record.name, record.dt, np.array(record.acceleration[:points]))


def make_work(law: str = "linear", *, short: bool = False) -> Work:
    """Return the work: the whole of El Centro 1940 N-S, or its first seconds in the short form."""
    record, scene = ps.find_record("el_centro"), ps.get_preset("mate2015")
    motion, contact = cut(record, SHORT_SECONDS) if short else record, scene.contact
    stiffness, restitution = float(contact.linear_stiffness or 0.0), float(contact.restitution or 1.0)
    return Work(scene, motion, "linear", stiffness, restitution).under(law)


def neighbouring_gaps(n: int) -> np.ndarray:
    """`n` gaps (m) at equal distances over `GAPS`."""
    return np.linspace(*GAPS, n)
