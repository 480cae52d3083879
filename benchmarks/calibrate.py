"""Measures what ``measured.json`` of the package holds: ``python -m benchmarks.calibrate``.

For every law and scheme, seeded random scenarios are run with ever finer steps and compared with a converged run: a
line of error against steps in the shortest time. The measured curve is a quantile of the lines. To be run again
whenever a kernel or a law changes; it takes a while, most of it for compiling.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from pounding_sweep.accuracy.extremes import oscillator
from pounding_sweep.engine.compile import prepare
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.output.dataset import package_version
from pounding_sweep.plan.advice import (
    CLASSES,
    EXACT_STEPS,
    MEASURED,
    approach_speeds,
    highest_frequency,
    shortest_contact,
)
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.request.spec import PRECISIONS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import Status, reducers_for, relative_errors

#: Share of the scenarios whose error the curves hold: the others cost a step or two of refinement.
QUANTILE = 0.9
#: Scenarios of each law, row and record: two lane groups.
SCENARIOS = 32
#: Steps per 0.01 s (of exact flight: its `refinement`), by method and number format; single precision uses no more.
LADDERS = {
    (s.name, form): tuple(n for n in s.ladder if form == "float64" or n <= s.finest_float32)
    for form in PRECISIONS
    for s in SCHEMES.values()
    if s.ladder
}
#: Steps per 0.01 s of the converged run (rk4, located, float64), and of the one that it must agree with.
CONVERGED, CHECKED = 256, 128
#: How well they must agree, relatively, for a scenario to be counted.
AGREED = 1e-5
#: Level at which the cost of a step is measured, sub-steps of contacts included: one that moderate errors ask for.
COSTED = 2
#: Steps in the shortest time at which the lines are read off.
NODES = tuple(float(2**i) for i in range(13))
#: A node needs the lines of this many scenarios.
FEWEST = 24
#: Undamped laws run in the kernel of a damped one of the same elastic force, to the last bit; fewer are compiled.
HOSTS = {"linear": "kelvin_voigt", "hertz": "hertz_damped"}
#: Middle of the random contact stiffnesses by force exponent (kN/m**exponent).
STIFFNESS = {None: 0.0, 1.0: 1e6, 1.5: 1e7}
#: Every output that has an error; closing_max is that of a displacement.
OUTPUTS = tuple(name for names in CLASSES.values() for name in names if name != "closing_max")


def scenes() -> tuple[Scene, ...]:
    """Return rows of three shapes, two of each: all of a shape run in the same kernels."""
    rows = (  # periods (s), masses (t), storeys and damping ratios
        ((0.13, 200.0, 1, 0.02), None),
        ((0.8, 90.0, 1, 0.05), None),
        ((0.25, 60.0, 1, 0.05), (0.45, 100.0, 2, 0.05), (0.45, 140.0, 1, 0.02)),
        ((0.22, 250.0, 1, 0.02), (1.1, 150.0, 2, 0.05), (0.6, 90.0, 1, 0.1)),
        ((0.3, 120.0, 3, 0.05), (0.5, 300.0, 3, 0.02)),
        ((0.9, 600.0, 3, 0.01), (0.6, 100.0, 3, 0.05)),
    )
    buildings = (
        [Wall() if part is None else oscillator(name, *part) for name, part in zip("abc", row, strict=False)]
        for row in rows
    )
    return tuple(Scene(row, gaps=[0.01] * (len(row) - 1)) for row in buildings)


def records() -> tuple[Record, ...]:
    """Return the earthquakes, of firm and of softer ground, one as long as real ones are."""
    return (
        synthetic_record(11, duration=20.0, dt=0.01, pga=4.0),
        synthetic_record(12, duration=40.0, dt=0.02, pga=3.0, ground_frequency=10.0),
    )


@dataclass(frozen=True)
class RandomScenarios:
    """Random scenarios of one law, row and record."""

    law: Law
    scene: Scene
    record: Record
    gaps: np.ndarray  # gaps (m), 0.3 to 0.98 of the largest closing displacement without pounding; shape (n, pairs)
    #: 0.01 to 10 times `STIFFNESS`, so that either contacts or modes are the shorter; 0.15 to 0.95; shape (n,)
    stiffness: np.ndarray
    restitution: np.ndarray

    @classmethod
    def draw(cls, law: Law, scene: Scene, record: Record, seed: int) -> RandomScenarios:
        """Draw the scenarios of a seed."""
        random = np.random.Generator(np.random.PCG64(seed))
        n = SCENARIOS
        restitution = random.uniform(0.15, 0.95, n)
        stiffness = STIFFNESS[law.exponent] * 10.0 ** random.uniform(-2.0, 1.0, n)
        gaps = closing(scene, record) * random.uniform(0.3, 0.98, (n, len(scene.gaps)))
        return cls(law, scene, record, gaps, stiffness, restitution)

    def kernel(self, method: str, precision: str, level: float) -> RowKernel:
        """Return the kernel with so many steps per 0.01 s, or of exact flight that is so much finer."""
        host = get_law(HOSTS[self.law.key]) if self.law.key in HOSTS else None
        numerics = Numerics(method, 0.01 / level, precision=precision)
        if SCHEMES[method].flies_exactly:
            numerics = replace(numerics, dt=self.exact_step(level), refinement=level)
        return RowKernel(self.scene, self.law, numerics, reducers_for(OUTPUTS), host=host)

    def exact_step(self, refinement: float) -> float:
        """Return the short step (s) of exact flight that the advice would take."""
        return float(math.pi / highest_frequency(self.scene)[0] / (EXACT_STEPS * refinement))

    def run(self, method: str, precision: str, level: float) -> dict[str, Any]:
        """Run the scenarios."""
        kernel, ones = self.kernel(method, precision, level), np.ones(len(self.gaps))
        inputs: dict[str, Any] = {"gaps": self.gaps, "stiffness": self.stiffness, "restitution": self.restitution}
        return variables_of(kernel, kernel.run(self.record, scale=ones, **inputs), OUTPUTS, self.record)

    def shortest(self) -> np.ndarray:
        """Shortest time of each scenario (s), as the advice sees it."""
        speeds = np.tile(approach_speeds(self.scene, self.record), (len(self.gaps), 1))
        contact = shortest_contact(self.scene, self.law, self.stiffness, self.restitution, speeds)
        return np.minimum(contact, math.pi / highest_frequency(self.scene))

    def stable(self, method: str, level: float) -> np.ndarray:
        """Where a scheme is stable at such a level."""
        limit = largest_step(self.scene, self.law, self.stiffness, self.restitution, method=method)
        return np.asarray(limit >= (self.exact_step(level) if SCHEMES[method].flies_exactly else 0.01 / level))


def closing(scene: Scene, record: Record) -> np.ndarray:
    """Largest closing displacement (m) of every pair without pounding."""
    kernel = RowKernel(scene, get_law("none"), Numerics("rk4", 2e-3), reducers_for(["closing_max"]))
    one = np.ones(1)
    raw = kernel.run(record, scale=one, gaps=np.zeros((1, len(scene.gaps))), stiffness=one, restitution=one)
    found = np.zeros(len(scene.gaps))
    for contact, reached in zip(scene.contacts, raw["closing"][0], strict=True):
        found[contact.pair] = max(found[contact.pair], reached)
    return found


def _by_class(values: dict[str, Any], reference: dict[str, Any]) -> dict[str, np.ndarray]:
    """Error of each scenario by class of outputs; infinite where it has no values."""
    errors = relative_errors(OUTPUTS, values, reference)
    lost = values["status"] == Status.DIVERGED
    return {
        kind: np.where(lost, np.inf, np.max([errors[name] for name in names if name in errors], axis=0))
        for kind, names in CLASSES.items()
    }


def _nodes(scheme: tuple[str, str]) -> Sequence[float]:
    """Return the steps in the shortest time at which errors are read off; of exact flight its ladder."""
    return LADDERS[scheme] if SCHEMES[scheme[0]].flies_exactly else NODES


def lines(
    cell: RandomScenarios, scheme: tuple[str, str], reference: dict[str, Any], kept: np.ndarray
) -> dict[str, np.ndarray]:
    """Error of each kept scenario by class at `NODES` (of exact flight: at its ladder), shape (kept, nodes)."""
    shortest, ladder, nodes = cell.shortest(), LADDERS[scheme], _nodes(scheme)
    errors = [_by_class(cell.run(*scheme, n), reference) for n in ladder]
    stable = np.array([cell.stable(scheme[0], n) for n in ladder])
    result = {}
    for kind in CLASSES:
        table = np.clip(np.array([error[kind] for error in errors]), 1e-17, 1e3)
        result[kind] = np.full((len(kept), len(nodes)), np.nan)
        for line, scenario in zip(result[kind], kept, strict=True):
            use = stable[:, scenario]
            if use.sum() > 1:
                factor = 1.0 if SCHEMES[scheme[0]].flies_exactly else shortest[scenario] / 0.01
                steps = np.log(np.array(ladder)[use] * factor)
                line[:] = np.interp(np.log(nodes), steps, np.log(table[use, scenario]), left=np.nan, right=np.nan)
    return result


def curve(found: np.ndarray, nodes: Sequence[float] = NODES) -> list[list[float]]:
    """Return the quantile of many lines (log of error, shape (scenarios, nodes)) as points (steps, error)."""
    points = []
    for node, column in zip(nodes, found.T, strict=True):
        known = column[np.isfinite(column)]
        if len(known) >= FEWEST:
            points.append([node, float(f"{math.exp(np.quantile(known, QUANTILE)):.3g}")])
    best = min(range(len(points)), key=lambda i: points[i][1])  # beyond, only rounding errors grow
    return points[: best + 1]


def calibrate(
    schemes: Sequence[tuple[str, str]] = tuple(LADDERS),
    laws: Sequence[Law] = tuple(LAWS.values()),
    say: Any = lambda text: None,
) -> dict[str, Any]:
    """Measure laws under schemes; returns what ``measured.json`` holds of them."""
    started = time.perf_counter()
    nothing = records()[0], np.zeros((1, 1)), np.zeros(1), np.zeros(1)
    cells = [RandomScenarios(law, scene, *nothing) for scene in scenes() for law in laws]
    shapes = [cell.kernel(*scheme, 1).shape for cell in cells for scheme in schemes]
    compiled = prepare(shapes, workers=2)
    say(f"{compiled} kernels compiled in {time.perf_counter() - started:.0f} s")
    errors: dict[str, dict[str, Any]] = {f"{method}/{precision}": {} for method, precision in schemes}
    left_out = total = 0
    for law in laws:
        gathered: dict[tuple[str, str], list[dict[str, np.ndarray]]] = {scheme: [] for scheme in schemes}
        for cell in _cells(law):
            reference, checked = (cell.run("rk4", "float64", level) for level in (CONVERGED, CHECKED))
            change = np.max(list(_by_class(checked, reference).values()), axis=0)
            kept = np.flatnonzero(change <= AGREED)
            left_out, total = left_out + len(change) - len(kept), total + len(change)
            for scheme in schemes:
                gathered[scheme].append(lines(cell, scheme, reference, kept))
        for scheme, parts in gathered.items():
            errors["/".join(scheme)][law.key] = {
                kind: curve(np.concatenate([part[kind] for part in parts]), _nodes(scheme)) for kind in CLASSES
            }
        say(f"{law.key} done after {time.perf_counter() - started:.0f} s")
    about = {
        "made_by": "python -m benchmarks.calibrate",
        "version": package_version(),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "machine": platform.machine(),
        "quantile": QUANTILE,
        "scenarios": total,
        "left_out": left_out,
        "seconds": round(time.perf_counter() - started),
    }
    return {"about": about, "cost": {"/".join(scheme): _cost(scheme) for scheme in schemes}, "errors": errors}


def _cells(law: Law) -> Iterator[RandomScenarios]:
    for i, scene in enumerate(scenes()):
        for j, record in enumerate(records()):
            yield RandomScenarios.draw(law, scene, record, seed=100 + 10 * i + j)


def _cost(scheme: tuple[str, str]) -> float:
    """Measured ns of one scenario, step (of exact flight: long step) and degree of freedom, of the largest rows."""
    most = max(scene.n_dof for scene in scenes())
    exact = SCHEMES[scheme[0]].flies_exactly
    level = 1.0 if exact else COSTED
    found = []
    for key in ("kelvin_voigt", "hertz_damped", "modified_kelvin_voigt"):
        for cell in (cell for cell in _cells(get_law(key)) if cell.scene.n_dof == most):
            kernel = cell.kernel(*scheme, level)
            each = int(kernel.flight_substeps(cell.record)[0]) if exact else kernel.numerics.steps(cell.record)
            seconds = []
            for _ in range(3):
                begun = time.process_time()  # other programs on the core do not count
                cell.run(*scheme, level)
                seconds.append(time.process_time() - begun)
            steps = (cell.record.n_points - 1) * each
            found.append(1e9 * min(seconds) / (steps * SCENARIOS * cell.scene.n_dof))
    return float(f"{np.median(found):.3g}")


def write(data: dict[str, Any], path: Path) -> None:
    """Write measured errors, one law of one scheme a line."""
    parts = []
    for scheme, laws in data["errors"].items():
        rows = ",\n".join(f"      {json.dumps(law)}: {json.dumps(found)}" for law, found in laws.items())
        parts.append(f"    {json.dumps(scheme)}: {{\n{rows}\n    }}")
    head = "".join(f"  {json.dumps(key)}: {json.dumps(data[key])},\n" for key in ("about", "cost"))
    path.write_text("{\n" + head + '  "errors": {\n' + ",\n".join(parts) + "\n  }\n}\n", encoding="utf-8")


def merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Return `old` with the schemes and laws of `new` in place of its own."""
    errors = {scheme: {**old["errors"].get(scheme, {}), **laws} for scheme, laws in new["errors"].items()}
    return {"about": new["about"], "cost": {**old["cost"], **new["cost"]}, "errors": {**old["errors"], **errors}}


def main() -> None:
    """Measure, and write the file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibrate", description=__doc__)
    data = Path(__file__).parents[1] / "pounding_sweep" / "data"
    parser.add_argument("-o", "--output", type=Path, default=data / MEASURED, help="file to write")
    names = ["/".join(scheme) for scheme in LADDERS]
    parser.add_argument("--only", nargs="+", choices=names, help="schemes to measure; the file keeps the others")
    parser.add_argument("--laws", nargs="+", choices=list(LAWS), help="laws to measure; the file keeps the others")
    arguments = parser.parse_args()
    schemes = [scheme for scheme, name in zip(LADDERS, names, strict=True) if name in (arguments.only or names)]
    laws = [LAWS[key] for key in arguments.laws or LAWS]
    found = calibrate(schemes, laws, lambda text: print(text, file=sys.stderr, flush=True))
    if (arguments.only or arguments.laws) and arguments.output.exists():
        found = merged(json.loads(arguments.output.read_text(encoding="utf-8")), found)
    write(found, arguments.output)


if __name__ == "__main__":
    main()
