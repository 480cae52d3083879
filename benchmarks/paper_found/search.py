"""What the paper leaves open, and designs over it that look for the values nearest to Tables 3 to 5."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.paper_found.fit import FARTHEST, FITTED, Numbers, Squares, likelihood, of_paper, squares
from pounding_sweep.base.errors import UnlikelyWarning
from pounding_sweep.model.building import Building, rayleigh_factors
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import Scene
from pounding_sweep.paper.study import BUILDINGS, GAP, READINGS, RESTITUTION
from pounding_sweep.records import Record
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import STATUS

#: Step (s) of the located runs, in contact.
STEP = 2e-3
#: Interval (s) of a program's output: the least step that the paper names. Its numbers of impacts are read in two ways,
#: "contacts": floors that begin to touch, and "samples": output points at which they do.
SAMPLING = 0.02
OUTPUTS = ("displacement_max", "displacement_min", "impact_force_max", "impact_count", "contact_time")
#: Values of inputs by key, shape (points,) each.
Points = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Open:
    """An input that the paper leaves open, or that its tables put in question."""

    key: str
    title: str
    short: str  # where there is little room
    unit: str
    low: float  # ends of what is tried
    high: float
    factor: float = 1.0  # to the unit

    def label(self, title: str) -> str:
        """Return a title with the unit."""
        return f"{title} ({self.unit or '-'})"

    def text(self, value: float) -> str:
        """Write a value with its unit."""
        return f"{self.factor * value:.3g} {self.unit}".strip()


#: Inputs of every building and contact.
INPUTS: dict[str, Open] = {
    one.key: one
    for one in (
        *(
            Open(b, f"stiffness of the {b} building over the printed one", f"{b} stiffness", "", 0.4, 4.0)
            for b in BUILDINGS
        ),
        Open("stiffness", "gap stiffness", "gap stiffness", "kN/m", 5e4, 4e6),
        Open("gap", "gap", "gap", "mm", 0.005, 0.02, 1e3),
        Open("damping_ratio", "damping ratio", "damping ratio", "%", 0.02, 0.15, 1e2),
        Open("scale", "factor on the records", "record factor", "", 0.75, 1.33),
    )
}
#: Those of Table 5, law by law; gap stiffness in kN/m, of Hertz-type laws in kN/m^1.5.
LAW_INPUTS: dict[float | None, dict[str, tuple[float, float]]] = {
    1.0: {"stiffness": (2e4, 4e6), "restitution": (0.2, 0.95), "gap": (0.005, 0.05)},
    1.5: {"stiffness": (2e3, 3e7), "restitution": (0.2, 0.95), "gap": (0.005, 0.05)},
}
Box = Mapping[str, tuple[float, float]]
WIDE: Box = {one.key: (one.low, one.high) for one in INPUTS.values()}


def reading_points() -> dict[str, np.ndarray]:
    """Return the inputs of the readings, in their order."""
    printed = get_preset(READINGS["as_printed"].preset)
    found: dict[str, list[float]] = {key: [] for key in INPUTS}
    for reading in READINGS.values():
        scene = get_preset(reading.preset)
        for own, first in zip(scene.buildings, printed.buildings, strict=True):
            found[own.name].append(own.storey_stiffnesses[0] / first.storey_stiffnesses[0])
        damping = scene.buildings[0].damping_ratio
        for key, value in (("gap", GAP), ("damping_ratio", damping), ("scale", 1.0)):
            found[key].append(value)  # type: ignore[arg-type]
        found["stiffness"].append(scene.contact.linear_stiffness or np.nan)
    return {key: np.array(values) for key, values in found.items()}


def design(box: Box, samples: int, seed: int) -> dict[str, np.ndarray]:
    """Return points of a scrambled Sobol' sequence, logarithms of inputs spread evenly over a box."""
    from scipy.stats import qmc

    shares = qmc.Sobol(len(box), rng=seed).random(samples)
    ends = np.log(np.array(list(box.values())))
    return dict(zip(box, np.exp(ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])).T, strict=True))


def taken(points: Points, at: np.ndarray) -> dict[str, np.ndarray]:
    """Return some of the points."""
    return {key: values[at] for key, values in points.items()}


def narrowed(points: Points, misfit: np.ndarray, few: int) -> Box:
    """Return the box between the 10 % and 90 % fractiles of the few best points."""
    best = np.argsort(misfit)[:few]
    ends = {key: np.exp(np.quantile(np.log(values[best]), (0.1, 0.9))) for key, values in points.items()}
    return {key: (float(low), float(high)) for key, (low, high) in ends.items()}


def cases_of(points: Points, law: str, records: Iterable[str]) -> list[dict[str, Any]]:
    """Return the listed cases of points: those of the first record, then those of the next."""
    names = [key for key in points if key not in BUILDINGS]
    factors = {name: points[name] ** -0.5 for name in BUILDINGS if name in points}
    found = []
    for record, i in product(records, range(len(points["gap"]))):
        case: dict[str, Any] = {"law": law, "record": record, **{key: float(points[key][i]) for key in names}}
        if factors:
            case["period_factors"] = {name: float(values[i]) for name, values in factors.items()}
        found.append(case)
    return found


def run(
    points: Points, records: Sequence[Record], scene: Scene | None = None, law: str = "linear", **how: Any
) -> xr.Dataset:
    """Run points under all records, on the row as printed or another one."""
    cases = cases_of(points, law, [record.name for record in records])
    row = scene or get_preset(READINGS["as_printed"].preset)
    how = {"method": "exact", "dt": STEP, "audit": 0.0, **how}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnlikelyWarning)  # designs try contacts that no building has
        return Sweep(row, records, cases=cases, outputs=OUTPUTS, **how).run(scheduler="synchronous")


def numbers(cube: xr.Dataset, records: int) -> dict[str, np.ndarray]:
    """Return what tables hold of a cube of `run`: missing where a run has no values."""

    def values(name: str) -> np.ndarray:
        found = cube[name].values.reshape(records, -1, *cube[name].shape[1:])
        return np.swapaxes(found, 0, 1)

    valued = np.isin(cube["status"].values, [int(status) for status in STATUS if status.has_values])
    ok = np.where(valued, 1.0, np.nan).reshape(records, -1).T[:, :, None, None]
    both = [np.abs(values(name)) for name in OUTPUTS[:2]]
    return {
        "displacement": np.concatenate(both, axis=-2) * ok,
        "force": values("impact_force_max") * ok,
        "contacts": values("impact_count") * ok,
        "samples": values("contact_time") / SAMPLING * ok,
    }


def held_against(
    cube: xr.Dataset, records: Sequence[Record], law: str = "linear", missing: float = FARTHEST
) -> Squares:
    """Hold a cube of `run` against the paper's tables; `missing` is the square of a run without values."""
    found = against_paper(numbers(cube, len(records)), records, law)
    return replace(found, values=np.nan_to_num(found.values, nan=missing))


def against_paper(own: Numbers, records: Sequence[Record], law: str = "linear") -> Squares:
    """Hold numbers of points against the paper's tables."""
    names = [record.name for record in records]
    return squares(own, of_paper(names, law), names)


@dataclass(frozen=True)
class Designs:
    """Points that were tried, and how near they came."""

    points: Points
    squares: Squares
    boxes: tuple[Box, ...]  # of each round
    samples: tuple[int, ...]  # points of each round

    @property
    def weights(self) -> np.ndarray:
        """Likelihood of every point over how densely the rounds together tried there: sums go over the first box."""
        density = np.zeros(len(self.squares))
        for box, count in zip(self.boxes, self.samples, strict=True):
            inside = np.ones(len(density), bool)
            for key, (low, high) in box.items():
                inside &= (self.points[key] >= low) & (self.points[key] <= high)
            volume = np.prod([np.log(high / low) for low, high in box.values()])
            density += inside * count / volume
        found = likelihood(self.squares.misfit(), int(self.squares.where().sum())) / density
        return np.asarray(found / found.sum())

    @property
    def best(self) -> int:
        """The point with the least misfit."""
        return int(np.argmin(self.squares.misfit()))


def search(records: Sequence[Record], samples: Sequence[int], few: int = 32, box: Box = WIDE, seed: int = 1) -> Designs:
    """Try a design over all inputs, then one over the box of the few best points so far, and so on."""
    tried: list[dict[str, np.ndarray]] = []
    found: list[Squares] = []
    boxes: list[Box] = []
    for number, count in enumerate(samples):
        if number:
            points = {key: np.concatenate([one[key] for one in tried]) for key in box}
            box = narrowed(points, np.concatenate([one.misfit() for one in found]), few)
        boxes.append(box)
        tried.append(design(box, count, seed + number))
        found.append(held_against(run(tried[-1], records), records))
    together = Squares(np.concatenate([one.values for one in found]), found[0].quantity, found[0].record)
    points = {key: np.concatenate([one[key] for one in tried]) for key in box}
    return Designs(points, together, tuple(boxes), tuple(samples))


#: Sets of inputs that are fitted while the others stay as printed.
FEWER: tuple[tuple[str, ...], ...] = (
    *((key,) for key in INPUTS),
    ("right", "stiffness"),
    *(("right", "stiffness", key) for key in INPUTS if key not in ("right", "stiffness")),
)


def fewer(records: Sequence[Record], samples: Sequence[int]) -> dict[tuple[str, ...], Designs]:
    """Search over some inputs alone, the others as printed."""
    printed = {key: float(values[0]) for key, values in reading_points().items()}
    return {
        free: search(records, samples, box={key: WIDE[key] if key in free else (at, at) for key, at in printed.items()})
        for free in FEWER
    }


#: Modes that Rayleigh damping takes its ratio in: of each building, or of the whole row of nine floors.
DAMPINGS = {
    "building's modes 1 and 2, as printed": ("building", 0, 1),
    "building's modes 1 and 3": ("building", 0, 2),
    "building's modes 2 and 3": ("building", 1, 2),
    "row's modes 1 and 2": ("row", 0, 1),
    "mode 1, by masses alone": ("mass", 0, 0),
    "mode 1, by stiffnesses alone": ("stiffness", 0, 0),
}
OTHER_SIGN = "ground motion of the other sign"


def damped(scene: Scene, modes: tuple[str, int, int], ratio: float) -> Scene:
    """Return a row with Rayleigh damping of this ratio in these modes, said by ratios in each building's first two."""
    kind, first, second = modes
    row = np.sort(np.concatenate([building.frequencies for building in scene.buildings]))

    def of(building: Building) -> Building:
        w = building.frequencies
        if kind in ("building", "row"):
            two = (w if kind == "building" else row)[[first, second]]
            a, b = rayleigh_factors(two, (ratio, ratio))
        else:
            a, b = (2.0 * ratio * w[0], 0.0) if kind == "mass" else (0.0, 2.0 * ratio / w[0])
        ratios = 0.5 * (a / w[:2] + b * w[:2])
        ratios += 1e-9 * (ratio - ratios)  # rounding must not make a factor of 0 negative
        return replace(building, damping_ratio=tuple(ratios.tolist()))

    return Scene([of(building) for building in scene.buildings], gaps=scene.gaps, contact=scene.contact)


def scene_at(points: Points, at: int) -> Scene:
    """Return the row of one point, with its own stiffnesses, gap, damping and gap stiffness."""
    printed, ratio = get_preset(READINGS["as_printed"].preset), float(points["damping_ratio"][at])
    row = []
    for building in printed.buildings:
        stiffnesses = tuple(k * float(points[building.name][at]) for k in building.storey_stiffnesses)
        row.append(replace(building, stiffnesses=stiffnesses, damping_ratio=ratio))
    contact = replace(printed.contact, linear_stiffness=float(points["stiffness"][at]))
    return Scene(row, gaps=[float(points["gap"][at])] * len(printed.gaps), contact=contact)


def other_forms(records: Sequence[Record], box: Box, points: Points, at: int, samples: int) -> dict[str, Squares]:
    """Try forms of damping, and ground motions of the other sign, around a point: a design over the other inputs."""
    centre = scene_at(points, at)
    around = {name: float(points[name][at]) for name in BUILDINGS}  # factors on the row are over the centre's
    inner = {key: (low / around.get(key, 1.0), high / around.get(key, 1.0)) for key, (low, high) in box.items()}
    del inner["damping_ratio"]
    tried = design(inner, samples, seed=11)
    ratio = get_preset(READINGS["as_printed"].preset).buildings[0].damping_ratio
    rows = {title: damped(centre, modes, ratio) for title, modes in DAMPINGS.items()}  # type: ignore[arg-type]
    found = {title: held_against(run(tried, records, row), records) for title, row in rows.items()}
    turned = [Record(record.name, record.dt, -record.acceleration) for record in records]
    found[OTHER_SIGN] = held_against(run(tried, turned, rows[next(iter(DAMPINGS))]), records)
    return found


#: Fixed steps (s) of a plain program: force switched by the sign of the penetration, peaks at steps alone.
PLAIN_STEPS = (0.01, 0.005, 0.002, 0.001)


def plain_steps(records: Sequence[Record], points: Points) -> dict[float, Squares]:
    """Run points with a plain RK4 of fixed steps; missing values where that is unstable."""
    plain: dict[str, Any] = {"method": "rk4", "locate": False, "force_unstable": True}
    return {step: held_against(run(points, records, dt=step, **plain), records, missing=np.nan) for step in PLAIN_STEPS}


@dataclass(frozen=True)
class LawFit:
    """What fits the forces and numbers of impacts of one law in Table 5, on a given row."""

    law: str
    points: Points
    squares: Squares  # of the design
    printed: Squares  # one point: as printed, on the row as printed
    at_gap: Squares  # of a design with the printed gap


#: Quantities of Table 5.
OF_LAW = tuple(name for name in FITTED if name != "displacement")


def law_fit(law: str, records: Sequence[Record], row: Scene, samples: int) -> LawFit:
    """Try contact stiffness, restitution and gap of a law, then the first two at the printed gap."""
    about = LAWS[law]
    box = dict(LAW_INPUTS[about.exponent])
    if not about.takes_restitution:
        del box["restitution"]
    points = design(box, samples, seed=21)
    near = design({key: ends for key, ends in box.items() if key != "gap"}, samples // 2, seed=22)
    near["gap"] = np.full(samples // 2, GAP)
    found = [held_against(run(one, records, row, law), records, law) for one in (points, near)]
    first = get_preset(READINGS["as_printed"].preset)
    own = first.contact.reference(about.exponent or 1.0)
    given = {"stiffness": np.array([own]), "gap": np.array([GAP])}
    if about.takes_restitution:
        given["restitution"] = np.array([RESTITUTION])
    printed = held_against(run(given, records, first, law), records, law)
    return LawFit(law, points, found[0], printed, found[1])
