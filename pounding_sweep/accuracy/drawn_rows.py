"""Random realistic rows, and scenarios of them: what promises are judged by, and nothing was calibrated with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pounding_sweep.accuracy.calibrate import OUTPUTS, closing
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Building, Scene, Wall
from pounding_sweep.records import Record, read_record, resolve_record, synthetic_record
from pounding_sweep.spec.axes import Case
from pounding_sweep.spec.build import build_spec
from pounding_sweep.spec.spec import SweepSpec

#: Storeys of the buildings of a row; 0: a wall.
SHAPES = ((1, 0), (1, 1), (2, 1), (1, 1, 1), (2, 2), (0, 2, 1), (3, 2, 0), (2, 3, 2), (3, 3, 3), (5, 4))
#: Scenarios of one row, law and record.
CASES = 16


def earthquakes(files: Iterable[str | Path] = ()) -> list[Record]:
    """Return El Centro, synthetic motions of 40 s, and the records in files."""
    return [
        resolve_record("el_centro"),
        synthetic_record(101, duration=40.0, dt=0.01, pga=3.0),
        synthetic_record(102, duration=40.0, dt=0.02, pga=3.0, ground_frequency=8.0),
        *(read_record(name) for name in files),
    ]


def draw(seed: int, number: int, laws: Sequence[str], records: Sequence[Record]) -> SweepSpec:
    """Draw a row of buildings, a law and a record, and `CASES` scenarios of gap, stiffness, restitution and scale."""
    random = np.random.default_rng([seed, number])
    storeys = SHAPES[number % len(SHAPES)]
    law = get_law(laws[(number + number // len(SHAPES)) % len(laws)])
    record = records[int(random.integers(len(records)))]

    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

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
        row.append(Building(f"b{i}", masses, [stiffer * k for k in plain.stiffnesses], ratio))
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
        )
        for scale in scales
    ]
    return build_spec(scene=scene, records=record, cases=cases, outputs=OUTPUTS, audit=0.0)
