"""The paper, found out: the reading of what it leaves open that comes nearest to its Tables 3 to 5, and how near.

python -m benchmarks.paper_found -o paper_found
"""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.paper_found.fit import (
    FITTED,
    HeldOut,
    Resampled,
    Squares,
    held_out,
    likelihood,
    of_paper,
    quantiles,
    resampled,
    rounding,
    squares,
)
from benchmarks.paper_found.plain import plain_program
from benchmarks.paper_found.search import (
    INPUTS,
    OF_LAW,
    PLAIN_STEPS,
    SAMPLING,
    STEP,
    Designs,
    LawFit,
    against_paper,
    fewer,
    held_against,
    law_fit,
    numbers,
    other_forms,
    plain_steps,
    reading_points,
    run,
    scene_at,
    search,
    taken,
)
from pounding_sweep.base.text import print_table
from pounding_sweep.figures.style import COLOURS, in_style
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.pages import Grid, ungrouped
from pounding_sweep.paper.study import GAP, READINGS, RESTITUTION, paper_records, record_title
from pounding_sweep.records import Record
from pounding_sweep.records.catalogue import Folders

#: Points of a search's rounds, of one over fewer inputs, of a form of damping, and of a law's design: powers of 2.
ROUNDS, FEW, FORM, LAW = (2**13, 2**11, 2**11, 2**11, 2**11, 2**11), (2**8, 2**7, 2**7), 2**9, 2**11
#: What is said of a range: between these fractiles.
RANGE = (0.05, 0.5, 0.95)
#: Fractile of the misfits of a design that says how near it comes, less by chance than its best point.
NEAR = 0.01
#: Quantities of the tables of misfits, with their headings.
_QUANTITIES = {
    "displacement": "Table 3, displacements",
    "force": "Table 4, forces",
    "contacts": "Table 4, impacts as contacts",
    "samples": "Table 4, impacts as samples",
}


@dataclass(frozen=True)
class Found:
    """What the search found."""

    records: tuple[Record, ...]
    missing: Mapping[str, str]  # records that are not at hand -> why
    scenarios: int  # how many were run in all
    designs: Designs
    readings: Squares  # of the readings, and last the best point
    counts: Mapping[str, np.ndarray]  # their numbers, see `search.numbers`
    sap: Squares  # of the paper's SAP2000 against its MATLAB program
    half: float  # misfit of the best point at half the step
    held: tuple[HeldOut, ...]
    boot: Resampled
    fewer: Mapping[tuple[str, ...], Designs]
    other_forms: Mapping[str, Squares]
    steps: Mapping[float, Squares]  # plain steps -> those of `readings`
    program: Squares  # of the plain program with variable steps, points as `readings`
    laws: tuple[LawFit, ...]

    @property
    def labels(self) -> list[str]:
        """Names of the points of `readings`."""
        return [*(reading.label for reading in READINGS.values()), "best"]


def find(
    folders: Folders = None,
    rounds: Sequence[int] = ROUNDS,
    few: Sequence[int] = FEW,
    form: int = FORM,
    law: int = LAW,
    say: Callable[[str], None] = lambda text: None,
) -> Found:
    """Search, and judge what was found."""
    records, missing = paper_records(folders)
    names = [record.name for record in records]
    paper = of_paper(names)
    say(f"search: {sum(rounds) * len(records)} scenarios")
    designs = search(records, rounds)
    best = taken(designs.points, np.array([designs.best]))
    points = {key: np.append(values, best[key]) for key, values in reading_points().items()}
    cube = run(points, records)
    readings = held_against(cube, records)
    half = float(held_against(run(best, records, dt=0.5 * STEP), records).misfit()[0])
    sap = squares({key: v[None] for key, v in of_paper(names, program="sap2000").items()}, paper, names)
    say("fewer inputs")
    less = fewer(records, few)
    say("forms of damping, plain programs")
    # the box of the round in the middle: wide enough to adapt to another form, near enough to find its best
    tried = other_forms(records, designs.boxes[len(designs.boxes) // 2], designs.points, designs.best, form)
    rows = [scene_at(points, i) for i in range(len(points["gap"]))]
    ran = [
        [plain_program(row, record.scaled(scale), SAMPLING) for record in records]
        for row, scale in zip(rows, points["scale"], strict=True)
    ]
    program = {key: np.array([[one[key] for one in row] for row in ran]) for key in paper}
    say("Table 5, law by law")
    laws = []
    for key in MATE2015_MODELS[:-1]:
        say(f"  {key}")
        laws.append(law_fit(key, records, rows[-2], law))
    per_record = sum(rounds) + (1 + len(PLAIN_STEPS)) * len(rows) + 1 + len(tried) * form
    per_record += len(less) * sum(few) + len(laws) * (law + law // 2 + 1)
    return Found(
        tuple(records),
        missing,
        per_record * len(records),
        designs,
        readings,
        numbers(cube, len(records)),
        sap,
        half,
        tuple(held_out(designs.squares, readings[np.arange(len(READINGS))])),
        resampled(designs.squares, readings[np.arange(len(READINGS))]),
        less,
        tried,
        plain_steps(records, points),
        against_paper(program, records),
        tuple(laws),
    )


def verdict(found: Found) -> list[str]:
    """Say in a few sentences what was found; every number and choice of words is computed."""
    printed, as_run, best = found.readings.misfit()
    sap = float(found.sap.misfit()[0])
    groups, fits = int(found.readings.where().sum()), "A reading fits" if best <= sap else "No reading fits"
    said = [
        f"{fits}: the best of {len(found.designs.squares)} points is {best:.2f} away from the paper's MATLAB numbers, "
        f"{best / sap:.1f} times as far as its SAP2000 numbers ({sap:.2f})."
    ]
    for number, (label, misfit) in enumerate(zip(found.labels[:2], (printed, as_run), strict=True)):
        ratio = found.boot.references[number] / found.boot.misfit
        low, middle, high = np.quantile(ratio, RANGE)
        said.append(
            f"The reading {label} is {misfit:.2f} away, {misfit / best:.1f} times as far as the best. Where points are "
            f"chosen by some entries and judged by others, it is {middle:.2f} times as far ({low:.2f} to {high:.2f}); "
            f"the chosen one is nearer in {np.mean(ratio > 1.0):.0%} of {ratio.size} draws."
        )
    worth = min(fitted_sets(found), key=lambda one: one.criterion)
    values = [f"{INPUTS[key].title} {INPUTS[key].text(v)}" for key, v in zip(worth.free, worth.values, strict=True)]
    said.append(
        f"{len(INPUTS)} values were fitted to {3 * groups} numbers, which are about {groups} independent ones. Of "
        f"fewer values, the others as printed, those worth fitting are {len(worth.free)}: "
        f"{', '.join(values) or 'none'} (misfit {worth.misfit:.2f})."
    )
    printed_values, weights = reading_points(), found.designs.weights
    lists: dict[bool, list[str]] = {True: [], False: []}  # by whether the printed value is within its range
    for key, one in INPUTS.items():
        low, _, high = quantiles(found.designs.points[key], weights, RANGE)
        lists[bool(low <= printed_values[key][0] <= high)].append(one.title)
    outside, within = (", ".join(lists[inside]) or "nothing" for inside in (False, True))
    said.append(f"The data want another value than printed of: {outside}. They do not of: {within}.")
    as_samples, as_contacts = (
        float(found.designs.squares.misfit(("displacement", "force", name)).min()) for name in ("samples", "contacts")
    )
    said.append(
        f"The paper's numbers of impacts are nearer to {1e3 * SAMPLING:g} ms samples in contact than to contacts: "
        f"with them the least misfit is {as_samples:.2f}, with contacts {as_contacts:.2f}."
        if as_samples < as_contacts
        else f"The paper's numbers of impacts are no nearer to samples in contact ({as_samples:.2f}) than to contacts "
        f"({as_contacts:.2f})."
    )
    other = [
        f"{LAWS[one.law].model} ({1e3 * low:.0f} to {1e3 * high:.0f} mm)"
        for one in found.laws
        for low, _, high in [_law_range(one, "gap")]
        if not low <= GAP <= high
    ]
    said.append(
        f"Models whose forces and impacts want another gap than {1e3 * GAP:g} mm: {', '.join(other) or 'none'}."
    )
    return said


def nearness_grid(found: Found) -> Grid:
    """Write how near each reading comes to Tables 3 and 4."""

    def misfits(one: Squares) -> list[str]:
        return [f"{float(one.misfit(names)[0]):.3f}" for names in [*((name,) for name in _QUANTITIES), FITTED]]

    floor = rounding(of_paper([record.name for record in found.records]))
    rows = [["the paper's SAP2000", *misfits(found.sap)]]
    rows += [[label, *misfits(found.readings[[i]])] for i, label in enumerate(found.labels)]
    together = np.sqrt(np.mean([floor[name] ** 2 for name in FITTED]))
    rows.append(["rounding of the tables alone", *(f"{v:.3f}" for v in (*(floor[n] for n in _QUANTITIES), together))])
    headings = [("misfit to the paper's MATLAB", text) for text in [*_QUANTITIES.values(), "all"]]
    return Grid("How near to Tables 3 and 4", [*ungrouped("numbers"), *headings], rows)


def inputs_grid(found: Found) -> Grid:
    """Write which values fit, and within which range."""
    readings, weights = reading_points(), found.designs.weights
    rows = []
    for key, one in INPUTS.items():
        values = found.designs.points[key]
        shown = [*readings[key], one.low, one.high, values[found.designs.best], *quantiles(values, weights, RANGE)]
        shown += np.quantile(values[found.boot.chosen], (RANGE[0], RANGE[2])).tolist()
        rows.append([one.label(one.title), *(f"{one.factor * value:.3g}" for value in shown)])
    names = [f"{share:.0%}" for share in RANGE]
    headings = [*ungrouped("input", *found.labels[:2]), ("tried", "from"), ("tried", "to"), ("", "best")]
    headings += [*(("likelihood", text) for text in names), ("bootstrap", names[0]), ("bootstrap", names[2])]
    return Grid(f"Which values fit ({1.0 / (weights**2).sum():.0f} points carry the likelihood)", headings, rows)


class Fitted(NamedTuple):
    """Some inputs fitted, the others as printed."""

    free: tuple[str, ...]
    values: tuple[float, ...]  # of the best point
    misfit: float
    criterion: float  # the Bayesian information criterion, normal errors of one unknown size: the least is worth most


def fitted_sets(found: Found) -> list[Fitted]:
    """Return nothing fitted, the searches over fewer inputs, and all inputs fitted."""
    groups = int(found.readings.where().sum())
    rows: list[tuple[tuple[str, ...], tuple[float, ...], float]] = [((), (), float(found.readings.misfit()[0]))]
    for free, one in [*found.fewer.items(), (tuple(INPUTS), found.designs)]:
        rows.append((free, tuple(float(one.points[key][one.best]) for key in free), float(one.squares.misfit().min())))
    logs = float(np.log(groups))
    return [Fitted(*row, 2.0 * groups * float(np.log(row[2])) + len(row[0]) * logs) for row in rows]


def fewer_grid(found: Found) -> Grid:
    """Write how near fewer inputs come, the others as printed, and whether more of them are worth it."""
    rows = []
    for one in fitted_sets(found):
        titles = "all" if len(one.free) == len(INPUTS) else ", ".join(INPUTS[key].short for key in one.free) or "none"
        values = ", ".join(INPUTS[key].text(value) for key, value in zip(one.free, one.values, strict=True))
        rows.append([titles, values, f"{one.misfit:.3f}", f"{one.criterion:.1f}"])
    headings = ungrouped("fitted", "values", "misfit", "Bayesian information criterion")
    return Grid("Fewer values fitted, the others as printed", headings, rows)


def held_out_grid(found: Found) -> Grid:
    """Write how points chosen by some entries fare with others."""
    rows = []
    for one in found.held:
        judged = record_title(one.judged) if one.fitted == "the other records" else one.judged
        rows.append([one.fitted, judged, *(f"{v:.3f}" for v in (one.chosen, *one.references, one.best))])
    misfits = (f"misfit {label}" for label in ("of the chosen point", *found.labels[:2], "of the best there"))
    return Grid("Chosen by some entries, judged by others", ungrouped("chosen by", "judged by", *misfits), rows)


def impacts_grid(found: Found) -> Grid:
    """Write what the paper's numbers of impacts may count, record by record."""
    impacts = of_paper([record.name for record in found.records])["contacts"]
    rows = []
    for (at, label), (i, record) in product(list(enumerate(found.labels))[1:], enumerate(found.records)):
        some = impacts[i] > 0
        contacts, samples = (found.counts[name][at, i][some] / impacts[i][some] for name in ("contacts", "samples"))
        cells = [f"{np.median(contacts):.2f}", f"{np.median(1e3 * SAMPLING * samples):.1f}", f"{1e3 * record.dt:g}"]
        rows.append([label, record_title(record.name), str(int(some.sum())), *cells])
    names = ("reading", "record", "floors", "contacts over the paper's number", "ms in contact for each of them")
    headings = ungrouped(*names, "step of the record ms")
    return Grid("What the numbers of impacts count (medians)", headings, rows)


def forms_grid(found: Found) -> Grid:
    """Write how near forms of damping and the other sign of the motion come."""
    misfits = {title: one.misfit() for title, one in found.other_forms.items()}
    rows = [
        [title, *(f"{value:.3f}" for value in (misfit.min(), np.quantile(misfit, NEAR), np.median(misfit)))]
        for title, misfit in misfits.items()
    ]
    headings = ungrouped("damping of 5 % in", "least misfit", f"{NEAR:.0%} fractile", "median")
    size = len(next(iter(misfits.values())))
    return Grid(f"Form of the damping, sign of the motion ({size} points each)", headings, rows)


def programs_grid(found: Found) -> Grid:
    """Write what a plain program would have made of the readings."""

    def misfits(one: Squares) -> list[str]:
        return [f"{value:.3f}" if np.isfinite(value) else "unstable" for value in one.misfit()]

    rows = [[f"contacts and peaks located, {1e3 * STEP:g} ms", *misfits(found.readings)]]
    rows.append([f"contacts and peaks located, {500.0 * STEP:g} ms", "-", "-", f"{found.half:.3f}"])
    rows += [[f"RK4, {1e3 * step:g} ms, nothing located", *misfits(one)] for step, one in found.steps.items()]
    rows.append([f"as ode45, output every {1e3 * SAMPLING:g} ms", *misfits(found.program)])
    return Grid("Misfit by program", ungrouped("program", *found.labels), rows)


def _law_range(one: LawFit, key: str) -> np.ndarray:
    weights = likelihood(one.squares.misfit(OF_LAW), int(one.squares.where(OF_LAW).sum()))
    return quantiles(one.points[key], weights, RANGE)


def laws_grid(found: Found) -> Grid:
    """Write which contact stiffness, restitution and gap fit Table 5, law by law."""
    rows = []
    for one in found.laws:
        law = LAWS[one.law]
        misfit = one.squares.misfit(OF_LAW)
        best = int(np.argmin(misfit))
        least = (one.printed.misfit(OF_LAW)[0], one.at_gap.misfit(OF_LAW).min(), misfit[best])
        cells = [law.model, *(f"{value:.3f}" for value in least)]
        for key, factor in (("stiffness", 1.0), ("restitution", 1.0), ("gap", 1e3)):
            if key not in one.points:
                cells += ["-", "-"]
                continue
            low, _, high = factor * _law_range(one, key)
            cells += [f"{factor * one.points[key][best]:.3g}", f"{low:.3g} to {high:.3g}"]
        rows.append(cells)
    ends = f"{RANGE[0]:.0%} to {RANGE[2]:.0%}"
    headings = [*ungrouped("model"), *(("misfit", t) for t in ("as printed", f"gap of {1e3 * GAP:g} mm", "best"))]
    for text in ("stiffness (kN/m, kN/m^1.5)", f"restitution (printed {RESTITUTION:g})", "gap (mm)"):
        headings += [(text, "best"), (text, ends)]
    return Grid(f"Table 5, law by law, on the row {found.labels[1]}", headings, rows)


def grids(found: Found) -> list[Grid]:
    """Return all tables."""
    tables = (nearness_grid, inputs_grid, fewer_grid, held_out_grid, impacts_grid, forms_grid, programs_grid, laws_grid)
    return [table(found) for table in tables]


@in_style()
def figure(found: Found) -> Figure:
    """Draw the misfit of every point against each input, and the paper's numbers of impacts against computed ones."""
    drawn = Figure(figsize=(7.2, 4.6), layout="constrained")
    axes = drawn.subplots(2, 4)
    misfit, readings = found.designs.squares.misfit(), reading_points()
    sap, top = float(found.sap.misfit()[0]), 1.05 * float(found.readings.misfit()[0])
    for ax, (key, one) in zip(axes.flat, INPUTS.items(), strict=False):
        values = one.factor * found.designs.points[key]
        ax.plot(values, misfit, ".", color="0.6", markersize=1.5, alpha=0.5, rasterized=True, label="points tried")
        marked = zip(found.labels, [*(one.factor * readings[key]), values[found.designs.best]], "sD*", strict=True)
        for number, (label, value, mark) in enumerate(marked):
            look: dict[str, Any] = {"color": COLOURS[number + 1], "markersize": 9 if mark == "*" else 5, "label": label}
            ax.plot([value], found.readings.misfit()[[number]], mark, **look)
        ax.axhline(sap, color="black", linestyle="--", linewidth=1.0, label="the paper's SAP2000")
        ax.set(xscale="log", xlabel=one.label(one.short), ylim=(0.0, top))
        _few_ticks(ax, one.factor * one.low, one.factor * one.high)
    for ax in axes[:, 0]:
        ax.set_ylabel("misfit (-)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    last = axes[1, 3]
    impacts = of_paper([record.name for record in found.records])["contacts"].ravel()
    for number, (name, label) in enumerate((("contacts", "contacts"), ("samples", f"{1e3 * SAMPLING:g} ms samples"))):
        look = {"color": COLOURS[number + 4], "markersize": 3.5, "label": label}
        last.plot(impacts, found.counts[name][-1].ravel(), "o^"[number], **look)
    most = 1.1 * float(impacts.max())
    last.plot([0.0, most], [0.0, most], color="black", linewidth=0.8)
    last.set(ylim=(0.0, 1.5 * most), xlabel="paper's impacts (-)", ylabel="computed (-)")  # room for the legend
    last.legend(loc="upper left", fontsize=7, borderpad=0.1, handletextpad=0.2)
    drawn.legend(handles, labels, loc="outside lower center", ncols=5, markerscale=1.0)
    return drawn


def _few_ticks(ax: Axes, low: float, high: float) -> None:
    """Label a short logarithmic axis with plain numbers, a long one with powers of ten."""
    if high / low > 30.0:
        ax.xaxis.set_minor_formatter("")
        return
    steps = (0.8, 1.0, 1.25) if high / low < 2.0 else [s * 10.0**n for n in (-1, 0, 1) for s in (1.0, 2.0, 5.0)]
    ticks = [tick for tick in steps if low <= tick <= high]
    ax.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    ax.minorticks_off()


def main() -> None:
    """Search, print what was found, and draw it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_found", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER", help="folder of the figure")
    parser.add_argument("--records", type=Path, action="append", metavar="FOLDER", help="folder with the records")
    arguments = parser.parse_args()
    say = partial(print, file=sys.stderr, flush=True)
    found = find(arguments.records, say=say)
    for text in found.missing.values():
        say(f"left out: {text}")
    print(f"{found.scenarios} scenarios, under {', '.join(record_title(one.name) for one in found.records)}\n")
    for text in verdict(found):
        print(textwrap.fill(f"- {text}", 118, subsequent_indent="  "))
    for grid in grids(found):
        print(f"\n{grid.title}\n")
        print_table([" ".join(pair).strip() for pair in grid.headings], grid.rows)
    arguments.output.mkdir(parents=True, exist_ok=True)
    figure(found).savefig(arguments.output / "paper_found.png", dpi=150)


if __name__ == "__main__":
    main()
