"""Error against cost of every tool on the same work."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.peers import Peer
from benchmarks.reference import force_errors
from benchmarks.timing import medians
from benchmarks.work import ERROR_GAPS, Peaks, Work, neighbouring_gaps


@dataclass(frozen=True)
class Point:
    """One tool at one setting."""

    #: the tool
    key: str
    title: str
    law: str  # contact law
    knob: str  # what the setting is: "dt" (s), "rtol" or "accuracy"
    setting: float  # its value
    error: float  # worst relative error of a peak impact force, over `ERROR_GAPS` and all contacts
    milliseconds: float  # processor time (ms) of one scenario


def measure(
    tools: Sequence[Peer], work: Work, reference: Peaks, *, short: bool, rounds: int, notify: Callable[[str], None]
) -> list[Point]:
    """Run every tool at each of its settings: once for the error, then in turns for the time."""
    found, jobs = [], []
    for tool in tools:
        if work.law not in tool.laws:
            continue
        gaps = neighbouring_gaps(tool.batch) if tool.batch > 1 else ERROR_GAPS[1:2]
        for setting in tool.short if short else tool.settings:
            notify(f"{tool.title}, {work.law}, {tool.knob} = {setting:g}")
            try:
                run = tool.prepare(work, setting)
                error = float(force_errors(run(ERROR_GAPS), reference).max())
                if tool.batch > 1:
                    run(gaps)  # compiled for this number of scenarios
            except (RuntimeError, ValueError) as failure:
                notify(f"  left out: {failure}")
                continue
            found.append((tool, setting, error, len(gaps)))
            jobs.append(lambda run=run, gaps=gaps: run(gaps))
    notify(f"{len(jobs)} settings are timed in {rounds} turns")
    seconds = medians(*jobs, rounds=rounds)
    return [
        Point(tool.key, tool.title, work.law, tool.knob, setting, error, 1e3 * taken / n)
        for (tool, setting, error, n), taken in zip(found, seconds, strict=True)
    ]


def cost_at(points: Sequence[Point], error: float) -> float:
    """Milliseconds of one scenario at a given error: between two settings by a straight line in log-log.

    Where every setting is more accurate, the cheapest of them; NaN where none is as accurate.

    Examples
    --------
    >>> coarse, fine = (Point("a", "a", "linear", "dt", 1.0, e, t) for e, t in ((1e-2, 1.0), (1e-4, 10.0)))
    >>> round(cost_at([coarse, fine], 1e-3), 3)
    3.162
    >>> cost_at([coarse, fine], 1e-1)
    1.0
    >>> cost_at([coarse, fine], 1e-5)
    nan
    """
    options = [p.milliseconds for p in points if p.error <= error]
    for a, b in pairwise(points):
        if a.error > error > b.error > 0.0:
            share = math.log(a.error / error) / math.log(a.error / b.error)
            options.append(a.milliseconds * (b.milliseconds / a.milliseconds) ** share)
    return min(options, default=math.nan)


def best_cost(points: Sequence[Point], error: float) -> tuple[str, float]:
    """Title and milliseconds of the cheapest tool among `points` at a given error."""
    by_tool: dict[str, list[Point]] = {}
    for point in points:
        by_tool.setdefault(point.title, []).append(point)
    costs = {title: cost for title, own in by_tool.items() if np.isfinite(cost := cost_at(own, error))}
    title = min(costs, key=lambda name: costs[name], default="")
    return title, costs.get(title, math.nan)
