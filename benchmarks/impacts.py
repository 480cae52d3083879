"""What a scenario costs by its number of impacts: ``python -m benchmarks.impacts [-o FIGURE.png]``.

The paper's row under El Centro at one gap after another, 256 scenarios of stiffnesses within 10 % at each, by `exact`
at steps of 2.5 ms in single precision with four outputs. Prints impacts of a scenario, its processor time, and draws
them with the straight line through them. Beside it are `rk4`, which steps through the whole record, and whole sweeps of
the usual outputs to the default accuracy, from plan to cube.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.engine import BATCH, OUTPUTS, run_chunks
from benchmarks.timing import medians
from benchmarks.work import Work, make_work
from pounding_sweep.figures.style import MARKED, in_style, subplots
from pounding_sweep.run.sweep import Sweep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Gaps (m): from hundreds of impacts to none.
GAPS = (0.003, 0.004, 0.005, 0.006, 0.008, 0.010, 0.012, 0.015, 0.018, 0.022)
#: Contact laws, and step (s) of both schemes.
LAWS, DT = ("linear", "hertz_damped"), 2.5e-3
#: What is no scheme but a sweep of nothing named, and its scenarios at each gap.
USUAL, SWEEP = "accuracy 1e-3", 2048


@dataclass(frozen=True)
class Series:
    """What was measured of one law by one scheme."""

    #: scheme and contact law
    method: str
    law: str
    #: mean number of impacts of a scenario, all floors together, and its processor time, shape (gaps,)
    impacts: np.ndarray
    microseconds: np.ndarray

    @property
    def line(self) -> tuple[float, float]:
        """Microseconds of an impact, and of a scenario without any, by least squares."""
        slope, start = np.polyfit(self.impacts, self.microseconds, 1)
        return float(slope), float(start)


def _job(work: Work, method: str, gap: float) -> Callable[[], dict[str, np.ndarray]]:
    stiffnesses = work.stiffness * np.linspace(0.9, 1.1, BATCH)
    given = {"gaps": gap, "stiffnesses": stiffnesses, "precision": "float32", "outputs": OUTPUTS}
    plan = Sweep(work.scene, work.record, work.law, method=method, dt=DT, **given).plan()
    return lambda: run_chunks(plan)


def _sweep(work: Work, gap: float) -> Callable[[], dict[str, np.ndarray]]:
    stiffnesses = work.stiffness * np.linspace(0.9, 1.1, SWEEP)
    sweep = Sweep(work.scene, work.record, work.law, gaps=gap, stiffnesses=stiffnesses)
    return lambda: {"impact_count": sweep.run(scheduler="synchronous")["impact_count"].values}


def measure(work: Work, method: str, law: str, gaps: Sequence[float] = GAPS, rounds: int = 5) -> Series:
    """Time a law by a scheme at some gaps (m), which take turns."""
    size, own = SWEEP if method == USUAL else BATCH, work.under(law)
    jobs = [_sweep(own, gap) if method == USUAL else _job(own, method, gap) for gap in gaps]
    counts = [np.clip(job()["impact_count"], 0, None).reshape(size, -1).sum(axis=1).mean() for job in jobs]
    return Series(method, law, np.array(counts), 1e6 * np.array(medians(*jobs, rounds=rounds)) / size)


@in_style()
def draw(found: Sequence[Series]) -> Figure:
    """Draw processor time against impacts, with the lines of what flies from touch to touch."""
    ax = subplots(1, 1, (5.2, 0.0, 3.6, 0.0))[0, 0]
    for each, look in zip(found, MARKED, strict=False):
        style = look | {"linestyle": "", "label": f"{each.method}, {each.law}"}
        ax.plot(each.impacts, each.microseconds, **style)
        if each.method != "rk4":
            slope, start = each.line
            ends = np.array([0.0, each.impacts.max()])
            ax.plot(ends, start + slope * ends, color=look["color"], linewidth=0.8)
    ax.set(xlabel="impacts of a scenario", ylabel="processor time of a scenario (µs)", xlim=(0, None), ylim=(0, None))
    figure = ax.figure
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def main() -> None:
    """Measure, print, and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.impacts", description=__doc__)
    parser.add_argument("-o", type=Path, metavar="FIGURE.png", help="draw them, too")
    given = parser.parse_args()
    work = make_work()
    found = [measure(work, method, law) for method in ("exact", "rk4", USUAL) for law in LAWS]
    for each in found:
        print(f"{each.method}, {each.law}: {each.line[1]:.1f} us, and {each.line[0]:.2f} us for each impact")
        for impacts, time in zip(each.impacts, each.microseconds, strict=True):
            print(f"  {impacts:7.1f} impacts {time:8.1f} us")
    if given.o:
        draw(found).savefig(given.o)


if __name__ == "__main__":
    main()
