"""The whole suite: what is measured, in which order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.arithmetic import measure_c
from benchmarks.axes import relative_throughput
from benchmarks.compare import measure
from benchmarks.engine import SCHEMES
from benchmarks.machine import describe
from benchmarks.million import run_file
from benchmarks.peers import Peer
from benchmarks.reference import converged, force_errors, independent
from benchmarks.report import Report, Size
from benchmarks.scaling import measure_growth
from benchmarks.sizes import GROUPS, job_of, plan_of, row_of, start_of, steps_of
from benchmarks.start import start_seconds
from benchmarks.throughput import grid_sweep, plan_seconds, run_sweep
from benchmarks.timing import medians, one_core
from benchmarks.work import ERROR_GAPS, GAPS, SHORT_SECONDS, Peaks, Work, cut, make_work
from pounding_sweep.kernel.spec import LANES

#: Laws that tools are compared under; the figure shows the first.
LAWS = ("linear", "hertz_damped", "nonlinear_viscoelastic")
#: Schemes of the engine that are compared under every law.
MAIN = ("exact", "rk4")
#: Step (s) of the exact scheme, and scenarios, where the engine around the kernels is measured.
STEP, SWEEP = 2.5e-3, 20_000
#: Heading of the figure.
CAPTION = "Three 3-storey buildings, El Centro 1940 N-S, linear contact law"
#: Rows (buildings, storeys) whose cost is compared with that of the first, which is the paper's.
SIZES = ((3, 3), (2, 1), (2, 5), (5, 5), (2, 10), (5, 10), (10, 10))
SHORT_SIZES = ((3, 3), (2, 1), (3, 6))

Notify = Callable[[str], None]


def run(
    peers: Sequence[Peer], *, short: bool, notify: Notify, save: Callable[[Report], None], tools: bool = False
) -> Report:
    """Measure everything, or the `tools` alone; `save` takes what is there after each part, so that none is lost."""
    work = make_work(short=short)
    missing = {peer.key: reason for peer in peers if (reason := peer.missing())}
    able = [peer for peer in peers if peer.key not in missing]
    report = Report(describe(able), _sentence(work), missing=list(missing.values()))
    parts = _Parts(report, work, able, short, notify)
    laws = LAWS[:1] if short else LAWS
    comparisons: list[Callable[[], None]] = [partial(parts.compare, law) for law in laws]
    # what takes longest comes last: the report is saved after each part
    groups = [(True, comparisons if tools else [parts.arithmetic, *comparisons, parts.axes])]
    if not tools:
        groups.append((False, [parts.engine] if short else [parts.engine, parts.million]))
        groups += [(True, [parts.sizes])] if short else [(True, [parts.sizes]), (False, [parts.growth])]
    for alone, members in groups:
        for part in members:
            with one_core() if alone else nullcontext():
                part()
            save(report)
    return report


@dataclass
class _Parts:
    """The parts of one run, each of which fills in its own of the report."""

    report: Report
    work: Work
    peers: Sequence[Peer]
    short: bool
    notify: Notify

    @property
    def rounds(self) -> int:
        return 3 if self.short else 7

    def arithmetic(self) -> None:
        self.notify("arithmetic: the C kernel")
        self.report.arithmetic = measure_c(self.work, self.rounds)

    def compare(self, law: str) -> None:
        own = self.work.under(law)
        reference = converged(own)
        schemes: Sequence[Peer] = SCHEMES
        if law == LAWS[0]:
            self.report.agreement = _agreement(own, reference, self.short, self.notify)
        else:
            schemes = [scheme for scheme in SCHEMES if scheme.key in MAIN]
        tools = [*schemes, *self.peers]
        self.report.points += measure(tools, own, reference, short=self.short, rounds=3, notify=self.notify)

    def axes(self) -> None:
        self.notify("axes")
        self.report.axes = relative_throughput(self.work, self.rounds, method="exact", dt=STEP)

    def sizes(self) -> None:
        sizes = SHORT_SIZES if self.short else SIZES
        self.report.sizes = measure_sizes(self.work, sizes, self.rounds, starts=not self.short, notify=self.notify)

    def engine(self) -> None:
        self.notify("sweeps from plan to file")
        run_sweep(grid_sweep(self.work, 100, method="exact", dt=STEP))  # compiled
        self.report.throughput = [run_sweep(grid_sweep(self.work, SWEEP, method="exact", dt=STEP))]
        counts = (100_000,) if self.short else (100_000, 1_000_000)
        self.report.plan_seconds = {n: plan_seconds(self.work, n) for n in counts}
        self.report.start = start_seconds(self.rounds)

    def growth(self) -> None:
        self.report.growth = measure_growth(self.work, rounds=3, notify=self.notify)

    def million(self) -> None:
        self.notify("a million scenarios")
        self.report.million = run_file()


def measure_sizes(
    work: Work, sizes: Sequence[tuple[int, int]], rounds: int, *, starts: bool, notify: Notify
) -> list[Size]:
    """Return what rows of other sizes cost, and, if asked for, what their kernels take to compile and to load."""
    motion = cut(work.record, SHORT_SECONDS)
    plans, jobs = [], []
    for buildings, storeys in sizes:
        notify(f"sizes: {buildings} x {storeys} storeys")
        plans.append(plan_of(row_of(buildings, storeys), motion))
        jobs.append(job_of(plans[-1]))
    each = []
    for (buildings, storeys), plan, seconds in zip(sizes, plans, medians(*jobs, rounds=rounds), strict=True):
        each.append(1e9 * seconds / (GROUPS * LANES * steps_of(plan) * buildings * storeys))
    return [
        Size(b, s, cost, cost / each[0], start_of(plan) if starts else None)
        for (b, s), plan, cost in zip(sizes, plans, each, strict=True)
    ]


def _agreement(work: Work, reference: Peaks, short: bool, notify: Notify) -> float:
    worst = 0.0
    for i, gap in enumerate(ERROR_GAPS[:1] if short else ERROR_GAPS):
        notify(f"independent solution, gap = {gap:g} m")
        one = Peaks(*(np.asarray(getattr(reference, name)[i : i + 1]) for name in Peaks.__dataclass_fields__))
        worst = max(worst, float(force_errors(independent(work, float(gap)), one).max()))
    return worst if math.isfinite(worst) else math.inf


def _sentence(work: Work) -> str:
    return (
        f"Row `mate2015`, {work.record.name}, {work.record.duration:.1f} s of motion; contact stiffnesses "
        f"{work.stiffness:,.0f} kN/m and, for Hertz-type laws, "
        f"{work.under('hertz_damped').stiffness:,.0f} kN/m^1.5, "
        f"restitution {work.restitution:g}. Errors at gaps of {', '.join(f'{1e3 * g:g}' for g in ERROR_GAPS)} mm; "
        f"times of scenarios with neighbouring gaps from {1e3 * GAPS[0]:g} to {1e3 * GAPS[1]:g} mm, "
        "as many at once as the tool takes, on one core."
    )
