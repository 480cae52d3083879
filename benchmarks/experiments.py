"""Two experiments computed from published numbers: ``python -m benchmarks.experiments [-o FOLDER]``.

A frame of three storeys that strikes itself (Figueiredo et al. 2009, LA-14393) and a golf ball on a floor. Prints what
was measured beside what is computed, with the range of what is assumed; writes the table and two figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.signal import csd, resample, welch

import pounding_sweep as ps
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.figures.style import COLOURS, finish, in_style, subplots

#: The frame: masses (t) of base and floors, stiffnesses (kN/m) of storeys, damping ratios of modes without contact.
MASSES = np.array([6.20, 7.50, 8.22, 7.66]) * 1e-3
STIFFNESSES = np.array([398.9, 464.4, 457.7])
DAMPING = np.array([0.063, 0.02, 0.0097])
#: What holds base and top to the ground (kN/m), so soft that it decides nothing.
SOFT = 2e-2, 1e-3
#: Contact stiffness 3 E I / L^3 of the column (kN/m); restitution, assumed.
CONTACT, RESTITUTION = 2.0e3, 0.8
#: Standard deviation of the top's acceleration without contact (m/s2), which the level of the force follows from.
LEVEL = 0.409 * STANDARD_GRAVITY
#: Sampling interval and duration of a test (s); band of the force (Hz); points of a segment of spectra; the rate (Hz)
#: at which the experiment was recorded.
DT, DURATION, BAND, SEGMENT, RECORDED = 1.0 / 2560.0, 25.6, (20.0, 150.0), 8192, 320.0
#: Where the peak of each mode is looked for (Hz), in all states.
WINDOWS = ((25.0, 42.0), (46.0, 63.0), (64.0, 85.0))
#: Frequencies (Hz) by gap (mm), as a public generator of artificial data quotes the report; without contact.
MEASURED = {0.20: (31.1, 54.4, 70.9), 0.15: (31.7, 54.5, 70.9), 0.13: (31.8, 54.9, 71.2)}
MEASURED |= {0.10: (32.4, 55.2, 71.4), 0.05: (33.5, 57.6, 74.2)}
MEASURED_OPEN = (30.7, 54.2, 70.7)
#: Of tests with contact, gaps and added masses mixed: mean and deviation (Hz); single tests without contact.
MIXED = ((30.87, 55.13, 71.30), (0.51, 1.29, 1.26), (30.9, 54.8, 71.6))
#: The golf ball: drops and rebounds with their deviations (m); restitution; intervals between touches after 1.1 m (s).
REBOUNDS = {0.8: (0.6383, 0.0044), 0.9: (0.7198, 0.0040), 1.0: (0.7902, 0.0070), 1.1: (0.8677, 0.0061)}
BALL, BALL_DEVIATION = 0.898, 0.006
INTERVALS = (0.838, 0.748, 0.670, 0.600)


class State(NamedTuple):
    """A state of the frame, and what is assumed of its contact."""

    gap: float = 1e3  # mm; by default nothing touches
    restitution: float = RESTITUTION
    factor: float = 1.0  # on the contact stiffness
    added: tuple[float, float] = (0.0, 0.0)  # masses on base and first floor (kg)


OPEN = State()
#: What is assumed, in the range that it may have: the first is taken for the curves.
ASSUMED = ((RESTITUTION, 1.0), (0.4, 1.0), (1.0, 1.0), (RESTITUTION, 0.5), (RESTITUTION, 2.0))
#: States 11 to 17 of the report.
STATES = tuple(State(gap) for gap in (0.15, 0.13, 0.10, 0.05))
STATES += tuple(State(gap, added=m) for gap, m in ((0.20, (1.2, 0.0)), (0.20, (0.0, 1.2)), (0.10, (0.0, 1.2))))


@cache
def fit_dashpots() -> np.ndarray:
    """Dashpots (kN s/m) of the rails and of the storeys, none negative, nearest to the measured damping ratios."""
    drifts = np.diff(np.eye(4), axis=0)
    root = 1.0 / np.sqrt(MASSES)
    values, vectors = np.linalg.eigh((drifts.T * STIFFNESSES) @ drifts * np.outer(root, root))
    strains = np.vstack([np.eye(4)[0], drifts]) @ (vectors * root[:, None])[:, 1:]  # the first mode is rigid
    shares = (strains**2 / (2.0 * np.sqrt(values[1:]))).T
    return np.array(nnls(shares / DAMPING[:, None], np.ones(3))[0])


def make_frame(added: tuple[float, float] = (0.0, 0.0)) -> ps.Scene:
    """Return the frame as two neighbours, base to second floor and top, joined by a link of the third storey."""
    masses = (MASSES + np.array([*added, 0.0, 0.0]) * 1e-3).tolist()
    stiffnesses, dashpots = [SOFT[0], *STIFFNESSES], fit_dashpots().tolist()
    left = ps.Building("frame", masses[:3], stiffnesses[:3], 0.0, [0.202] * 3, dashpots=dashpots[:3])
    right = ps.Building("top", masses[3:], [SOFT[1]], 0.0, [3 * 0.202])
    link = ps.Link("frame-top", [(3, 1)], stiffnesses[3], dashpots[3])
    return ps.Scene([left, right], [1e-4], ps.ContactProperties(linear_stiffness=CONTACT), links=[link])


def make_force(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a random force (kN) of unit deviation in the band, and the ground acceleration (m/s2) that exerts it."""
    rng, n = np.random.default_rng(seed), round(DURATION / DT)
    w = 2.0 * np.pi * np.fft.rfftfreq(n, DT)
    inside = (w >= 2.0 * np.pi * BAND[0]) & (w <= 2.0 * np.pi * BAND[1])
    force = inside * (rng.normal(size=w.size) + 1j * rng.normal(size=w.size))
    force *= n / np.sqrt(2.0 * np.sum(np.abs(force) ** 2))
    # spring and dashpot of the rails push the base by k u + c u' of the ground's displacement u
    ground = -(w**2) * force / (SOFT[0] + 1j * w * fit_dashpots()[0])
    return np.fft.irfft(force, n), np.fft.irfft(ground, n)


def top_acceleration(state: State, ground: np.ndarray) -> np.ndarray:
    """Total acceleration (m/s2) of the top floor."""
    contact: dict[str, Any] = {"law": "kelvin_voigt", "restitution_basis": "realised", "method": "exact", "dt": DT}
    contact |= {"stiffness": state.factor * CONTACT, "restitution": state.restitution, "gaps": 1e-3 * state.gap}
    one = ps.simulate(make_frame(state.added), ps.Record("noise", DT, ground), rest=0.0, **contact)
    return one.acceleration.sel(building="top", storey=1).values


class Tests(NamedTuple):
    """What tests of one state have."""

    frequency: np.ndarray  # peaks (Hz) of the transfer function that is averaged over all tests, shape (3,)
    single: np.ndarray  # of each test, shape (tests, 3)
    values: np.ndarray  # deviation of the top (g); largest force (N) and acceleration of the top (g), as recorded


def find_peaks(transfer: np.ndarray) -> np.ndarray:
    """Frequencies (Hz) of the largest value in each window, between lines by a parabola of the logarithms."""
    line, size = 1.0 / (SEGMENT * DT), np.log(np.abs(transfer))
    peaks = []
    for low, high in WINDOWS:
        i = int(low / line) + int(np.argmax(size[int(low / line) : int(high / line)]))
        a, b, c = size[i - 1 : i + 2]
        peaks.append(line * (i + (a - c) / (2.0 * (a - 2.0 * b + c))))
    return np.array(peaks)


def run_tests(states: Iterable[State], noises: int = 10) -> dict[State, Tests]:
    """Run every state, the one without contact too, with the same noises, each scaled to the level without contact."""
    rows: dict[State, list[tuple]] = {state: [] for state in (OPEN, *states)}
    for seed in range(noises):
        force, ground = (1e-3 * values for values in make_force(seed))
        free = top_acceleration(OPEN, ground)
        scale = LEVEL / free.std()
        spectrum = welch(scale * force, 1.0 / DT, nperseg=SEGMENT)[1]
        for state, tests in rows.items():
            top = scale * free if state == OPEN else top_acceleration(state, scale * ground)
            transfer = csd(scale * force, top, 1.0 / DT, nperseg=SEGMENT)[1] / spectrum
            g = resample(top, round(RECORDED * DT * top.size)) / STANDARD_GRAVITY
            tests.append((transfer, (g.std(), 1e3 * scale * np.abs(force).max(), np.abs(g).max())))
    answer = {}
    for state, tests in rows.items():
        transfers, values = map(np.array, zip(*tests, strict=True))
        answer[state] = Tests(find_peaks(transfers.mean(axis=0)), np.array(list(map(find_peaks, transfers))), values)
    return answer


def drop_ball(height: float, restitution: float) -> tuple[float, np.ndarray]:
    """Return the first rebound (m) and the intervals (s) between five touches of a ball dropped from a height (m)."""
    # a constant acceleration of the ground is gravity, the wall the floor; the spring is next to nothing
    scene = ps.Scene([ps.Building("ball", [1.0], [1e-5], 0.0), ps.Wall("floor")], [height])
    duration = np.sqrt(2.0 * height / STANDARD_GRAVITY) * (1.0 + 2.0 * sum(restitution**i for i in range(1, 5))) + 0.02
    gravity = ps.Record("gravity", 5e-4, np.full(int(duration / 5e-4), -STANDARD_GRAVITY))
    one = ps.simulate(scene, gravity, law="stereomechanical", restitution=restitution, method="exact", dt=5e-4, rest=0)
    fallen, speed, time = (one[name].values.squeeze() for name in ("displacement", "velocity", "time"))
    after = np.flatnonzero((speed[:-1] > 0.0) & (speed[1:] < 0.0)) + 1  # first points after touches
    instants = time[after] + (height - fallen[after]) / speed[after]
    return float(height - fallen[after[0] : after[1]].min()), np.diff(instants)


def shifts(tests: dict[State, Tests], gap: float) -> np.ndarray:
    """Shifts (Hz) at a gap (mm): averaged, their deviation over tests, and the range of what is assumed; (4, 3)."""
    assumed = [tests[State(gap, *values)].frequency - tests[OPEN].frequency for values in ASSUMED]
    deviation = (tests[State(gap)].single - tests[OPEN].single).std(axis=0)
    return np.array([assumed[0], deviation, np.min(assumed, axis=0), np.max(assumed, axis=0)])


@cache
def rebounds() -> np.ndarray:
    """Computed rebounds (m) of the drops, no deviation, and the range of the restitution's deviation; (4, drops)."""
    offsets = 0.0, -BALL_DEVIATION, BALL_DEVIATION
    middle, low, high = np.array([[drop_ball(height, BALL + x)[0] for height in REBOUNDS] for x in offsets])
    return np.array([middle, 0.0 * middle, low, high])


def frame_rows(tests: dict[State, Tests]) -> list[tuple]:
    """Return what the frame did: quantity, measured, computed, deviation over noises and range."""
    free, rows = tests[OPEN], list[tuple]()
    mixed = np.concatenate([tests[state].single for state in STATES])
    for i, (mean, spread, single) in enumerate(zip(*MIXED, strict=True)):
        mode, shift = f"mode {i + 1}", (mixed - free.single.mean(axis=0)).mean(axis=0)[i]
        rows.append((f"{mode}: frequency (Hz)", MEASURED_OPEN[i], free.frequency[i], free.single[:, i].std()))
        for gap, f in MEASURED.items():
            rows.append((f"{mode}, {gap:.2f} mm: shift (Hz)", f[i] - MEASURED_OPEN[i], *shifts(tests, gap)[:, i]))
        rows.append((f"{mode}, states 11 to 17: mean shift (Hz)", mean - single, shift))
        rows.append((f"{mode}, states 11 to 17: deviation over tests (Hz)", spread, mixed[:, i].std()))
    close = 100.0 * tests[State(0.15)].values[:, 0] / free.values[:, 0]
    for name, measured, values in (
        ("without contact: largest force (N)", 82.0, free.values[:, 1]),
        ("without contact: largest acceleration of the top (g)", 1.8, free.values[:, 2]),
        ("0.15 mm: deviation of the top over that without contact (%)", 100 * 0.401 / 0.409, close),
    ):
        rows.append((name, measured, values.mean(), values.std()))
    return rows


def ball_rows() -> list[tuple]:
    """Return what the ball did: quantity, measured, computed, difference in % and range."""
    drops = zip(REBOUNDS.items(), rebounds()[[0, 2, 3]].T, strict=True)
    rows = [(f"drop from {h} m: rebound (cm)", 100.0 * m, *100.0 * x) for (h, (m, _)), x in drops]
    intervals = zip(INTERVALS, drop_ball(1.1, BALL)[1], strict=True)
    rows += [(f"drop from 1.1 m: interval {i} (ms)", 1e3 * m, 1e3 * x) for i, (m, x) in enumerate(intervals, 1)]
    return [(name, m, x, 100.0 * (x / m - 1.0), *limits) for name, m, x, *limits in rows]


def format_table(*head: str, rows: Iterable[tuple]) -> str:
    """Return a table in Markdown: a name, numbers, and a range where there is one."""
    lines = [f"| {' | '.join((*head, 'range of what is assumed'))} |", "|---" * 5 + "|"]
    for name, *numbers in rows:
        cells = [*(f"{round(value, 2):.4g}" for value in numbers), "", ""]
        lines.append(f"| {' | '.join([name, *cells[:3], ' to '.join(filter(None, cells[3:]))])} |")
    return "\n".join(lines) + "\n"


def draw_range(ax: Any, x: Sequence[float], computed: np.ndarray, *measured: Sequence[float]) -> None:
    """Draw computed values with deviation and range, and measured ones, with their deviation where it is known."""
    middle, deviation, low, high = computed
    ax.fill_between(x, low, high, color=COLOURS[6], alpha=0.4, linewidth=0, label="range of what is assumed")
    ax.errorbar(x, middle, deviation, color=COLOURS[1], capsize=2, label="computed")
    ax.errorbar(x, *measured, fmt="o", color=COLOURS[0], capsize=2, label="measured")


@in_style()
def draw(tests: dict[State, Tests], folder: Path) -> None:
    """Draw shifts of frequencies against the gap, and rebounds against the drop."""
    axes, computed = subplots(1, 3, (0.5, 2.3, 2.9, 0.0)), np.array([shifts(tests, gap) for gap in MEASURED])
    for i, ax in enumerate(axes[0]):
        draw_range(ax, list(MEASURED), computed[:, :, i].T, [f[i] - MEASURED_OPEN[i] for f in MEASURED.values()])
        ax.set_title(f"mode {i + 1}, {MEASURED_OPEN[i]} Hz")
    finish(axes, "gap (mm)", "shift of the frequency (Hz)").savefig(folder / "experiments_frame.png", dpi=110)
    axes = subplots(1, 1, (4.4, 0.0, 3.2, 0.0))
    draw_range(axes[0, 0], list(REBOUNDS), rebounds(), *np.transpose(list(REBOUNDS.values())))
    finish(axes, "drop height (m)", "rebound height (m)").savefig(folder / "experiments_ball.png", dpi=110)


def main() -> None:
    """Compute, print, and write the table and the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.experiments", description=__doc__)
    parser.add_argument("-o", type=Path, metavar="FOLDER", help="write experiments.md and two figures there")
    given = parser.parse_args()
    tests = run_tests([*(State(gap, *values) for gap in MEASURED for values in ASSUMED), *STATES])
    text = format_table("frame", "measured", "computed", "deviation over noises", rows=frame_rows(tests))
    text += "\n" + format_table("ball", "measured", "computed", "difference (%)", rows=ball_rows())
    print(text)
    if given.o:
        (given.o / "experiments.md").write_text(text, encoding="utf-8")
        draw(tests, given.o)


if __name__ == "__main__":
    main()
