"""Random realistic rows, and scenarios of them: what promises are judged by, and nothing was calibrated with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibrate import OUTPUTS, closing
from pounding_sweep.model.building import Building, Foundation, Infill
from pounding_sweep.model.frames import cantilever_flexibility
from pounding_sweep.model.laws import Law, get_law
from pounding_sweep.model.scene import Bumper, Link, Scene, Wall
from pounding_sweep.records import Record, read_record, resolve_record, synthetic_record
from pounding_sweep.request.axes import Case
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import SweepSpec

#: Storeys of the buildings of a row; 0: a wall.
SHAPES = ((1, 0), (1, 1), (2, 1), (1, 1, 1), (2, 2), (0, 2, 1), (3, 2, 0), (2, 3, 2), (3, 3, 3), (5, 4))
#: Scenarios of one row, law and record.
CASES = 16
Row = Sequence[Building | Wall]


@dataclass(frozen=True)
class Kind:
    """What rows of a kind have beside elastic storeys on fixed ground."""

    #: what becomes of a building of such a row
    building: Callable[[Building, np.random.Generator], Building] = lambda building, random: building
    #: further arguments of its scene
    scene: Callable[[Row, np.random.Generator], dict[str, Any]] = lambda row, random: {}
    #: further values of its cases
    case: Callable[[Row, np.random.Generator], dict[str, Any]] = lambda row, random: {}
    takes: Callable[[Law], bool] = lambda law: True  # whether it goes with a law


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _strengths(building: Building, random: np.random.Generator) -> dict[str, Any]:
    """Yield at a twentieth to two fifths of the weight above, with hardening or without."""
    above = 9.81 * np.cumsum(building.masses[::-1])[::-1]
    return {
        "yield_strengths": (_log(random, 0.05, 0.4) * above).tolist(),
        "hardening": float(random.choice([0.0, 0.02, 0.1])),
    }


def _yields(building: Building, random: np.random.Generator) -> Building:
    damping = str(random.choice(["initial", "tangent"]))
    return replace(building, **_strengths(building, random), damping_stiffness=damping)


def _leans(building: Building, random: np.random.Generator) -> Building:
    return replace(building, **{**_strengths(building, random), "hardening": 0.1}, p_delta=True)


def _smooth(building: Building, random: np.random.Generator) -> Building:
    law = {"law": "bouc_wen", "n": float(random.choice([1.0, 2.0, 5.0]))}
    return replace(building, **_strengths(building, random), hysteresis=law)


def _degrades(law: str, building: Building, random: np.random.Generator) -> Building:
    """Yield, and lose strength from two to six yield drifts on; half of them by cycles, half of them with infill."""
    yields = replace(building, **_strengths(building, random))
    drifts = np.divide(yields.yield_strengths or 0.0, yields.storey_stiffnesses)
    backbone: dict[str, Any] = {
        "law": law,
        "cap_drift": (drifts * _log(random, 2.0, 6.0)).tolist(),
        "post_cap": -_log(random, 0.02, 0.3),
        "residual": float(random.choice([0.0, 0.1, 0.3])),
        "ultimate_drift": (drifts * _log(random, 10.0, 60.0)).tolist(),
    }
    if random.random() < 0.5:
        modes = ("strength", "post_cap", "unloading", "reloading")[: 3 if law == "bilinear" else 4]
        backbone["deterioration"] = {mode: (drifts * _log(random, 20.0, 100.0)).tolist() for mode in modes}
    if law == "pinching":
        backbone |= {name: float(random.uniform(0.2, 0.7)) for name in ("pinch_force", "pinch_drift")}
    infill = None
    if random.random() < 0.5:
        stiff, strong = _log(random, 0.3, 2.0), _log(random, 0.2, 1.0)
        wall = {"law": "pinching", "cap_drift": (2.0 * strong / stiff * drifts).tolist(), "post_cap": -0.1}
        infill = Infill(
            (stiff * np.array(yields.storey_stiffnesses)).tolist(),
            (strong * np.array(yields.yield_strengths)).tolist(),
            hysteresis=wall | {"pinch_force": 0.3, "pinch_drift": 0.3},
        )
    return replace(yields, hysteresis=backbone, infill=infill)


def _dashed(building: Building, random: np.random.Generator) -> Building:
    return replace(building, dashpots=[k * _log(random, 1e-3, 1e-2) for k in building.storey_stiffnesses])


def _founded(building: Building, random: np.random.Generator) -> Building:
    """On soil of two to twenty times the stiffness of the first storey."""
    mass, k = float(np.mean(building.masses)), building.storey_stiffnesses[0]
    rocks = k * building.elevations[-1] ** 2
    stiff, damped = ([_log(random, *range_) for _ in "ab"] for range_ in ((2.0, 20.0), (2e-3, 2e-2)))
    springs = [k * stiff[0], rocks * stiff[1], k * damped[0], rocks * damped[1]]
    return replace(building, foundation=Foundation(mass, 10.0 * mass, *springs))


def _dense(building: Building, random: np.random.Generator) -> Building:
    """Bend and shear as walls to frames do, of the same first period, under damping of modes or Rayleigh's."""
    flexible = cantilever_flexibility(building.elevations / building.elevations[-1], _log(random, 0.5, 30.0))
    modal = None if random.random() < 0.5 else random.uniform(0.01, 0.1, building.n_storeys).tolist()
    return replace(
        building,
        stiffnesses=None,
        stiffness_matrix=np.linalg.inv(flexible).tolist(),
        period=float(building.periods[0]),
        modal_damping=modal,
    )


def _uneven(building: Building, random: np.random.Generator) -> Building:
    return replace(building, storey_heights=random.uniform(2.8, 4.2, building.n_storeys).tolist())


def _linked(row: Row, random: np.random.Generator) -> dict[str, Any]:
    """Link the first floors of the first two buildings, of which rows with walls may have one only."""
    pairs = [both for both in pairwise(row) if all(isinstance(each, Building) for each in both)]
    if not pairs:
        return {}
    soft = min(each.storey_stiffnesses[0] for each in pairs[0] if isinstance(each, Building))
    parts = {"stiffness": soft * _log(random, 0.01, 0.3), "damping": soft * _log(random, 1e-4, 1e-2)}
    return {"links": [Link("-".join(each.name for each in pairs[0]), [1], **parts)]}


def _bumped(row: Row, random: np.random.Generator) -> dict[str, Any]:
    law = str(random.choice(["kelvin_voigt", "hertz_damped", "gonthier"]))
    pair = "-".join(each.name for each in row[:2])
    return {"bumpers": [Bumper(pair, law, stiffness=_log(random, 1e4, 1e6), restitution=0.5, thickness=0.0)]}


def _varied(row: Row, random: np.random.Generator) -> dict[str, Any]:
    names = [each.name for each in row if isinstance(each, Building)]
    factors = {what: {name: float(random.uniform(0.7, 1.4)) for name in names} for what in ("period", "mass")}
    return {f"{what}_factors": each for what, each in factors.items()} | {"damping_ratio": _log(random, 0.01, 0.1)}


#: Kinds of rows by name.
KINDS = {
    "plain": Kind(),
    "yielding": Kind(_yields),
    "links": Kind(scene=_linked),
    "foundations": Kind(_founded),
    "columns": Kind(
        _uneven,
        lambda row, random: {"contacts": "floors and columns"},
        takes=lambda law: law.exponent == 1.0 and not law.impulsive and not law.yields,
    ),
    "smooth": Kind(_smooth),
    "bumpers": Kind(scene=_bumped),
    "p_delta": Kind(_leans),
    "dashpots": Kind(_dashed),
    **{f"degrading {law}": Kind(partial(_degrades, law)) for law in ("bilinear", "peak_oriented", "pinching")},
    "matrices": Kind(_dense),
    "varied": Kind(case=_varied),
}


def earthquakes(files: Iterable[str | Path] = ()) -> list[Record]:
    """Return El Centro, synthetic motions of 40 s, and the records in files."""
    return [
        resolve_record("el_centro"),
        synthetic_record(101, duration=40.0, dt=0.01, pga=3.0),
        synthetic_record(102, duration=40.0, dt=0.02, pga=3.0, ground_frequency=8.0),
        *(read_record(name) for name in files),
    ]


def kind_of(number: int, kinds: Sequence[str], laws: Sequence[str]) -> str:
    """Return the kind of a drawn row; plain where none of the laws goes with it."""
    kind = kinds[(3 * number + number // len(SHAPES)) % len(kinds)]
    return kind if any(KINDS[kind].takes(get_law(key)) for key in laws) else "plain"


def draw(
    seed: int, number: int, laws: Sequence[str], records: Sequence[Record], kinds: Sequence[str] = ("plain",)
) -> SweepSpec:
    """Draw a row of buildings, a law and a record, and `CASES` scenarios of gap, stiffness, restitution and scale."""
    random, further = np.random.default_rng([seed, number]), np.random.default_rng([seed, number, 1])
    kind = KINDS[kind_of(number, kinds, laws)]
    storeys = SHAPES[number % len(SHAPES)]
    taken = [key for key in laws if kind.takes(get_law(key))]
    law = get_law(taken[(number + number // len(SHAPES)) % len(taken)])
    record = records[int(random.integers(len(records)))]
    log = partial(_log, random)

    row: list[Building | Wall] = []
    for i, n in enumerate(storeys):
        if n == 0:
            row.append(Wall())
            continue
        mass, period = log(50.0, 1000.0), n * log(0.07, 0.2) if n > 1 else log(0.1, 1.2)
        masses, shape = (mass * random.uniform(0.7, 1.3, n)).tolist(), random.uniform(0.7, 1.3, n)
        ratio = float(random.choice([0.01, 0.02, 0.05, 0.05, 0.1]))
        plain = Building(f"b{i}", masses, (1e3 * mass * shape).tolist(), ratio)
        stiffer = (plain.periods[0] / period) ** 2
        row.append(Building(f"b{i}", masses, [stiffer * k for k in plain.storey_stiffnesses], ratio))
    pairs = len(row) - 1
    scene = Scene(row, [0.0] * pairs)
    scales = [log(0.05, 0.8) * 9.81 / record.pga for _ in range(CASES)]
    far = closing(scene, record)
    middle = 1e6 if law.exponent in (None, 1.0) else 1e7
    cases = [
        Case(
            law=law.key,
            gap=tuple(float(g) for g in scale * far * 10.0 ** random.uniform(-2.0, -0.01, pairs)),
            stiffness=None if law.exponent is None else middle * log(0.1, 10.0),
            restitution=float(random.uniform(0.2, 0.95)) if law.takes_restitution else None,
            record=record.name,
            scale=scale,
            **kind.case(row, further),
        )
        for scale in scales
    ]
    row = [kind.building(each, further) if isinstance(each, Building) else each for each in row]
    scene = Scene(row, scene.gaps, **kind.scene(row, further))
    return build_spec(scene=scene, records=record, cases=cases, outputs=OUTPUTS, audit=0.0)
