"""Time against error of what a user may ask for: ``python -m benchmarks.trade [-o FIGURE.png]``, four kinds of rows.

The paper's row and five kinds made of it, four laws, El Centro. Times are of processors, kernels compiled; errors are
the largest of any output but numbers of impacts, relative, against the tightest accuracy; scenarios with another number
of impacts are counted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import pounding_sweep as ps
from benchmarks.timing import medians
from benchmarks.yielding import weakened
from pounding_sweep.figures.select import use_logarithms
from pounding_sweep.figures.style import MARKED, finish, in_style, subplots
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, Status, comparable, relative_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Contact laws; the last two are of Hertz' kind, which are stepped by stages.
LAWS = ("linear", "kelvin_voigt", "hertz", "hertz_damped")
#: Accuracies from the loosest to the tightest.
ACCURACIES = (1e-1, 5e-2, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Settings of the table by name.
SETTINGS: dict[str, dict[str, Any]] = {
    "`rk4`, 1 ms": {"method": "rk4", "dt": 1e-3},
    "`exact`, 1 ms": {"method": "exact", "dt": 1e-3},
    "`exact`, 1 ms, float32": {"method": "exact", "dt": 1e-3, "precision": "float32"},
    **{f"accuracy {accuracy:g}": {"accuracy": accuracy} for accuracy in ACCURACIES[:-1]},
}
#: What errors are measured against.
REFERENCE = {"accuracy": ACCURACIES[-1]}


def _founded(building: Building) -> Building:
    """On soil of five times the stiffness of its storeys."""
    mass, k = float(np.mean(building.masses)), 5.0 * building.storey_stiffnesses[0]
    rocks = k * building.elevations[-1] ** 2
    return replace(building, foundation=ps.Foundation(mass, 10.0 * mass, k, rocks, 1e-3 * k, 1e-3 * rocks))


def _smooth(building: Building) -> Building:
    return replace(building, hysteresis={"law": "bouc_wen", "n": 2.0})


def _leaning(building: Building) -> Building:
    return replace(building, p_delta=True)


def _plain(building: Building) -> Building:
    return building


#: Kinds of rows: whether their storeys yield, what becomes of a building, and the laws beside it.
KINDS: dict[str, tuple[bool, Callable[[Building], Building], tuple[str, ...]]] = {
    "elastic": (False, _plain, LAWS),
    "bilinear": (True, _plain, LAWS),
    "Bouc-Wen": (True, _smooth, LAWS[:2]),
    "foundations": (False, _founded, LAWS),
    "Bouc-Wen, Hertz": (True, _smooth, LAWS),
    "P-Delta": (True, _leaning, LAWS),
}


def sweep_of(kind: str, scenarios: int, **how: Any) -> ps.Sweep:
    """Return about so many scenarios of a kind of row."""
    base, record = ps.get_preset("mate2015"), ps.find_record("el_centro")
    yields, change, laws = KINDS[kind]
    scene = weakened(base, record) if yields else base
    scene = Scene([change(item) for item in scene.buildings], scene.gaps, scene.contact)
    gaps = np.linspace(0.001, 0.02, max(1, scenarios // (12 * len(laws)))).tolist()
    axes = {"gaps": gaps, "stiffness_factors": [0.5, 1.0, 2.0], "restitutions": [0.4, 0.5, 0.6, 0.8]}
    return ps.Sweep(scene, record, laws, **axes, outputs=DEFAULT_OUTPUTS, audit=0.0, **how)


def dearest_of_less(
    kind: str, scenarios: int = 480, accuracies: Iterable[float] = ACCURACIES, rounds: int = 3
) -> float:
    """Largest time of an accuracy over that of any tighter one."""
    sweeps = [sweep_of(kind, scenarios, accuracy=accuracy) for accuracy in accuracies]
    jobs = [lambda sweep=sweep: sweep.run(scheduler="synchronous") for sweep in sweeps]
    for job in jobs:
        job()
    seconds = medians(*jobs, rounds=rounds)
    return max(seconds[i] / min(seconds[i + 1 :]) for i in range(len(seconds) - 1))


def errors_of(cube: Any, fine: Any) -> tuple[float, str]:
    """Largest error of scenarios that are ok in both cubes, and in words with how many count other impacts."""
    ok = np.ravel((cube["status"] == Status.OK) & (fine["status"] == Status.OK))
    names, n = comparable(DEFAULT_OUTPUTS), cube["status"].ndim
    results, wanted = ({name: c[name].values.reshape(-1, *c[name].shape[n:]) for name in names} for c in (cube, fine))
    errors = relative_errors(names, results, wanted)
    counts = int((errors.pop("impact_count")[ok] > 0.0).sum())
    largest = max(error[ok].max(initial=0.0) for error in errors.values())
    others = f", {counts} count otherwise" * bool(counts) + f", {(~ok).sum()} not ok" * bool((~ok).any())
    return float(largest), f"{largest:.1e}{others}"


@in_style()
def draw(points: dict[str, list[tuple[float, float]]], kinds: list[str]) -> Figure:
    """Draw the worst error of each setting against its time, a panel for each kind of row."""
    axes = subplots(1, len(kinds), (0.6, 2.3, 3.6, 0.0), sharey=True)
    lines: dict[str, list[str]] = {}
    for name in points:
        lines.setdefault(
            "accuracies, 0.1 to 1e-5" if name.startswith("accuracy") else name.replace("`", ""), []
        ).append(name)
    for number, (panel, kind) in enumerate(zip(axes[0], kinds, strict=True)):
        for (label, names), look in zip(lines.items(), MARKED, strict=False):
            panel.plot(*zip(*(points[name][number] for name in names), strict=True), label=label, **look)
        panel.set(title=kind, xscale="log", yscale="log")
        use_logarithms(panel.xaxis)
    return finish(axes, "processor time (s)", "worst error (-)", legend=4)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trade", description=__doc__)
    parser.add_argument("--scenarios", type=int, default=3000, help="scenarios of each kind of row")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS)[:4], help="of rows")
    parser.add_argument("-o", type=Path, metavar="FIGURE.png", help="draw them, too")
    arguments = parser.parse_args()
    cells: dict[str, list[str]] = {name: [] for name in SETTINGS}
    points: dict[str, list[tuple[float, float]]] = {name: [] for name in SETTINGS}
    for kind in arguments.kinds:
        fine = sweep_of(kind, arguments.scenarios, **REFERENCE).run()
        for name, how in SETTINGS.items():
            sweep = sweep_of(kind, arguments.scenarios, **how)
            sweep.run(scheduler="synchronous")
            started = time.process_time()
            cube = sweep.run(scheduler="synchronous")
            seconds = time.process_time() - started
            error, text = errors_of(cube, fine)
            cells[name].append(f"{seconds:.2f} s, {text}")
            points[name].append((seconds, error))
    print(f"| setting | {' | '.join(arguments.kinds)} |\n|---|{'---|' * len(arguments.kinds)}")
    for name, texts in cells.items():
        print(f"| {name} | {' | '.join(texts)} |")
    if arguments.o:
        draw(points, arguments.kinds).savefig(arguments.o)


if __name__ == "__main__":
    main()
