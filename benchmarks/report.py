"""What was measured, as markdown and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmarks.arithmetic import Arithmetic
from benchmarks.compare import Point, best_cost, cost_at
from benchmarks.figure import ENGINE
from benchmarks.million import Run
from benchmarks.reference import STEP
from benchmarks.scaling import Growth
from benchmarks.sizes import Start
from benchmarks.throughput import Throughput

#: Errors at which tools are compared.
EQUAL_ERRORS = (1e-3, 1e-4, 1e-6, 1e-9)


@dataclass(frozen=True)
class Size:
    """Cost of one row of another size."""

    #: the row
    buildings: int
    storeys: int
    nanoseconds: float  # processor time (ns) of one degree of freedom, scenario and step of located rk4
    relative: float  # the same over that of the first row
    start: Start | None  # seconds to compile its kernel and to load it; None where not measured


@dataclass
class Report:
    """Everything that one run of the suite found; parts that were not run are None or empty."""

    machine: dict[str, str]  # machine, versions, date
    work: str  # the work, in a sentence
    points: list[Point] = field(default_factory=list)  # error and cost of every tool and setting
    #: largest relative difference of a peak force between the converged solution and the reference solver of the tests
    agreement: float | None = None
    missing: list[str] = field(default_factory=list)  # peers that could not be used, and why
    arithmetic: Arithmetic | None = None  # the engine's kernels beside a C kernel; None without a compiler
    sizes: list[Size] = field(default_factory=list)  # rows of other sizes
    growth: list[Growth] = field(default_factory=list)  # how cost grows
    axes: dict[str, float] = field(default_factory=dict)  # axis -> scenarios per second over those of a sweep over gaps
    throughput: list[Throughput] = field(default_factory=list)  # sweeps from plan to file
    plan_seconds: dict[int, float] = field(default_factory=dict)  # scenarios -> seconds to plan them
    start: dict[str, float] = field(default_factory=dict)  # seconds of starting each command
    million: Run | None = None  # the sweep of a million scenarios

    def to_json(self) -> dict[str, Any]:
        """Return everything as plain data, with what follows from it; numbers that are none become null."""
        data = asdict(self)
        data["equal_error"] = [
            {"law": law, "error": error, "tool": title, "milliseconds": cost, "times_the_engine": ratio}
            for law in _laws(self.points)
            for error in EQUAL_ERRORS
            for title, cost, ratio in equal_error(self.points, law, error)
        ]
        for one, growth in zip(data["growth"], self.growth, strict=True):
            one["exponent"] = growth.exponent
        for one, sweep in zip(data["throughput"], self.throughput, strict=True):
            one["efficiency"] = sweep.efficiency
        return _plain(data)

    def to_json_text(self) -> str:
        """Return `to_json` as text."""
        return json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n"

    def to_markdown(self) -> str:
        """Return all tables."""
        lines = [self.work, ""]
        lines += _table(("", ""), self.machine.items())
        for law in _laws(self.points):
            lines += [f"\n**Every tool and setting, law `{law}`**\n"]
            lines += _table(
                ("tool", "setting", "worst error", "ms per scenario"),
                [
                    (p.title, f"{p.knob} = {p.setting:g}", f"{p.error:.1e}", _number(p.milliseconds))
                    for p in self.points
                    if p.law == law
                ],
            )
            lines += [f"\n**At equal error, law `{law}`**, interpolated between settings\n"]
            lines += _table(
                ("error", "tool", "ms per scenario", "times the engine"),
                [
                    (f"{error:g}", title, _number(cost), _number(ratio))
                    for error in EQUAL_ERRORS
                    for title, cost, ratio in equal_error(self.points, law, error)
                ],
            )
        if self.agreement is not None:
            lines.append(
                f"\nErrors are relative to a converged solution (rk4 located at a step of {1e3 * STEP:g} ms). Its peak "
                f"forces differ by at most {self.agreement:.1e} from those of another program with adaptive steps."
            )
        lines += [f"\nNot measured: {reason}." for reason in self.missing]
        if (a := self.arithmetic) is not None:
            lines.append(
                f"\nArithmetic: beside a C kernel written by hand for this row (vectors of {a.width} doubles), the rk4 "
                f"kernel takes {a.plain:.2f} times as long where it does just the same, contacts not located, and "
                f"{a.located:.2f} times as long as sweeps use it."
            )
        for title, heads, rows in self._tables():
            if rows:
                lines += [f"\n**{title[0]}**{title[1]}\n", *_table(heads, rows)]
        return "\n".join(lines) + "\n"

    def _tables(self) -> Iterator[tuple[tuple[str, str], tuple[str, ...], list[tuple[str, ...]]]]:
        """Return title, what is added to it, headings and rows of the tables of the engine alone."""
        rows: list[tuple[str, ...]] = []
        for s in self.sizes:
            start = ("-", "-") if s.start is None else (_number(s.start.compiled), _number(s.start.loaded))
            numbers = str(s.buildings * s.storeys), _number(s.nanoseconds), f"{s.relative:.2f}"
            rows.append((f"{s.buildings} x {s.storeys}", *numbers, *start))
        heads = ("row", "degrees of freedom", "ns each and step", "over the first", "compiled (s)", "loaded (s)")
        yield ("Rows of other sizes", ", rk4 located, nothing touching"), heads, rows
        rows = [(f"`{axis}`", f"{ratio:.2f}") for axis, ratio in self.axes.items()]
        yield ("Sweeps over other axes", ", exact"), ("axis", "throughput over that of gaps"), rows
        rows = []
        for g in self.growth:
            costs = ", ".join(f"{value:g}: {_number(cost)}" for value, cost in zip(g.values, g.costs, strict=True))
            rows.append((g.quantity, g.unit, costs, "-" if math.isnan(g.exponent) else f"{g.exponent:.2f}"))
        yield ("How cost grows", ""), ("with", "cost", "measured", "exponent"), rows
        rows = [
            (f"{t.scenarios:,} scenarios, {t.workers} threads, plan to file: time in kernels", f"{t.efficiency:.0%}")
            for t in self.throughput
        ]
        rows += [(f"{n:,} scenarios planned", f"{_number(s)} s") for n, s in self.plan_seconds.items()]
        rows += [(f"start: {name}", f"{_number(s)} s") for name, s in self.start.items()]
        if (m := self.million) is not None:
            rows += [
                (f"{m.scenarios:,} scenarios from the command line, cube written", f"{_number(m.seconds)} s"),
                ("scenarios per second", f"{m.scenarios / m.seconds:,.0f}"),
                ("peak resident memory", f"{m.peak_bytes / 2**20:.0f} MiB"),
                ("cube", f"{m.cube_bytes / 2**20:.0f} MiB"),
            ]
        yield ("The engine around the kernels", ""), ("", ""), rows


def equal_error(points: Sequence[Point], law: str, error: float) -> list[tuple[str, float, float]]:
    """Tools by cost at a given error: title, milliseconds, and how many times the engine's cheapest row that is."""
    # tools that do not reach the error are left out
    own = [p for p in points if p.law == law]
    _, best = best_cost([p for p in own if p.title.startswith(ENGINE)], error)
    found = []
    for title in dict.fromkeys(p.title for p in own):
        cost = cost_at([p for p in own if p.title == title], error)
        if not math.isnan(cost):
            found.append((title, cost, cost / best))
    return sorted(found, key=lambda row: row[1])


def _laws(points: Sequence[Point]) -> list[str]:
    return list(dict.fromkeys(p.law for p in points))


def _number(value: float) -> str:
    """Three figures, without an exponent."""
    if not math.isfinite(value):
        return "-"
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{value:,.{digits}f}" if abs(value) < 1000 else f"{float(f'{value:.3g}'):,.0f}"


def _table(heads: Sequence[str], rows: Any) -> list[str]:
    return [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}", *(f"| {' | '.join(row)} |" for row in rows)]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
