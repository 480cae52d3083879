"""How near computed numbers come to the paper's Tables 3 to 5: one measure, and what can be said with it.

Two numbers a and b differ by 2 (a - b) / (|a| + |b|): 0 where they agree, 2 where one of them is zero alone. The
misfit is the root of the mean square of that, first over the entries of a quantity, then over the quantities.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pounding_sweep.paper.study import published

#: Digits of the tables: a unit of displacement (m), of force (kN) and of a number of impacts.
UNITS = {"displacement": 1e-3, "force": 1.0, "contacts": 1.0, "samples": 1.0}
#: What is fitted. "contacts" and "samples" are two meanings of the paper's numbers of impacts; see `search.SAMPLING`.
FITTED = ("displacement", "force", "samples")

#: Square of the largest relative difference: one number is zero, the other is not.
FARTHEST = 4.0
_DIRECTIONS = ("displacement_max", "displacement_min")

#: Values of a quantity, shape (..., records, places, storeys); places are buildings and directions, or pairs.
Numbers = Mapping[str, np.ndarray]


def of_paper(records: Sequence[str], law: str = "linear", program: str = "matlab") -> dict[str, np.ndarray]:
    """Return the numbers of Tables 3 to 5; displacements are of Model I alone, SAP2000's of Tables 3 and 4."""
    found = {}
    if law == "linear":
        three = published(3).sel(record=list(records), program=program)
        both = [three[name].transpose("record", "building", "storey").values for name in _DIRECTIONS]
        found["displacement"] = np.abs(np.concatenate(both, axis=-2))
    forces = published(5).sel(law=law) if program == "matlab" else published(4).sel(program=program)
    forces = forces.sel(record=list(records)).transpose("record", "pair", "storey")
    found["force"] = forces["impact_force_max"].values
    found["contacts"] = found["samples"] = forces["impact_count"].values
    return found


def relative_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return 2 (a - b) / (|a| + |b|), 0 where both are 0."""
    size = np.abs(a) + np.abs(b)
    return np.asarray(2.0 * (a - b) / np.where(size > 0.0, size, 1.0))


@dataclass(frozen=True)
class Squares:
    """Mean squares of relative differences over the storeys of a place, which move together: a group is one number."""

    values: np.ndarray  # shape (points, groups)
    quantity: np.ndarray  # of each group
    record: np.ndarray  # of each group

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, points: np.ndarray | list[int]) -> Squares:
        return Squares(self.values[points], self.quantity, self.record)

    def where(self, quantities: Sequence[str] = FITTED, records: Sequence[str] | None = None) -> np.ndarray:
        """Return which groups are of these quantities and records."""
        found = np.isin(self.quantity, quantities)
        return found if records is None else found & np.isin(self.record, records)

    def misfit(self, quantities: Sequence[str] = FITTED, records: Sequence[str] | None = None) -> np.ndarray:
        """Return the misfit of every point, over these quantities and records."""
        return self.weighed(self.where(quantities, records)[:, None].astype(float))[:, 0]

    def weighed(self, times: np.ndarray) -> np.ndarray:
        """Return the misfit with each group so many times, shape (groups, cases) -> (points, cases)."""
        total, count = np.zeros((len(self), times.shape[1])), np.zeros(times.shape[1])
        for quantity in np.unique(self.quantity):
            own = self.quantity == quantity
            number = times[own].sum(axis=0)
            total += self.values[:, own] @ times[own] / np.where(number > 0, number, 1)
            count += number > 0
        return np.asarray(np.sqrt(total / count))


def squares(own: Numbers, paper: Numbers, records: Sequence[str]) -> Squares:
    """Hold numbers of points, shape (points, records, places, storeys), against the paper's."""
    values, quantity, record = [], [], []
    for name in paper:
        found = np.mean(relative_difference(own[name], paper[name]) ** 2, axis=-1)
        places = found.shape[-1]
        values.append(found.reshape(len(found), -1))
        quantity += [name] * (len(records) * places)
        record += [each for each in records for _ in range(places)]
    return Squares(np.concatenate(values, axis=1), np.array(quantity), np.array(record))


def rounding(paper: Numbers) -> dict[str, float]:
    """Return the misfit by quantity of numbers that are right but for the rounding in the paper."""
    found = {}
    for name, values in paper.items():
        share = np.where(values != 0.0, UNITS[name] / np.sqrt(12.0) / np.where(values != 0.0, np.abs(values), 1.0), 0.0)
        found[name] = float(np.sqrt(np.mean(share**2)))
    return found


def likelihood(misfit: np.ndarray, groups: int) -> np.ndarray:
    """Return weights that sum to 1: likelihoods of normal errors of one unknown size, groups being independent."""
    least = misfit.min()
    found = (least / misfit) ** groups if least > 0.0 else (misfit == 0.0).astype(float)
    return np.asarray(found / found.sum())


def quantiles(values: np.ndarray, weights: np.ndarray, shares: Sequence[float]) -> np.ndarray:
    """Return weighted quantiles."""
    order = np.argsort(values)
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(shares, below, values[order])


@dataclass(frozen=True)
class HeldOut:
    """Points chosen by some entries, judged by others."""

    fitted: str  # what chose
    judged: str  # what judges
    chosen: float  # misfit there of the point that was best where it was chosen
    references: tuple[float, ...]  # misfits there of the reference points
    best: float  # least misfit there of any point


def held_out(points: Squares, references: Squares) -> Iterator[HeldOut]:
    """Choose by one table and judge by others; choose by all records but one and judge by that."""
    records = list(dict.fromkeys(points.record.tolist()))
    tables = (("Table 3", ["displacement"]), ("Table 4, forces", ["force"]), ("Table 4, impacts", ["samples"]))
    cases: list[tuple[str, Sequence[str], list[str], str, Sequence[str], list[str]]] = [
        (f"{name} alone", quantities, records, other, judges, records)
        for name, quantities in tables[:2]
        for other, judges in tables
        if other != name
    ]
    if len(records) > 1:
        for out in records:
            rest = [record for record in records if record != out]
            cases.append(("the other records", FITTED, rest, out, FITTED, [out]))
    for fitted, quantities, inside, judged, judges, outside in cases:
        chosen = int(np.argmin(points.misfit(quantities, inside)))
        there = points.misfit(judges, outside)
        others = references.misfit(judges, outside).tolist()
        yield HeldOut(fitted, judged, float(there[chosen]), tuple(others), float(there.min()))


@dataclass(frozen=True)
class Resampled:
    """Bootstrap: groups drawn with replacement, points chosen anew, judged by the groups that were not drawn."""

    chosen: np.ndarray  # point, of each draw
    misfit: np.ndarray  # its misfit over the groups left out, of each draw
    references: np.ndarray  # those of the reference points there, shape (references, draws)


def resampled(points: Squares, references: Squares, draws: int = 1000, seed: int = 1) -> Resampled:
    """Draw groups of each quantity by itself; see Efron & Tibshirani (1997), JASA 92(438), on what is left out."""
    rng = np.random.default_rng(seed)
    times = np.zeros((len(points.quantity), draws))
    for quantity in FITTED:
        own = np.flatnonzero(points.quantity == quantity)
        times[own] = rng.multinomial(len(own), np.full(len(own), 1.0 / len(own)), size=draws).T
    left = points.where()[:, None] & (times == 0)
    some = left.any(axis=0)
    times, left = times[:, some], left[:, some].astype(float)
    chosen = np.argmin(points.weighed(times), axis=0)
    judged = np.array(
        [points[[int(point)]].weighed(out[:, None])[0, 0] for point, out in zip(chosen, left.T, strict=True)]
    )
    return Resampled(chosen, judged, references.weighed(left))
