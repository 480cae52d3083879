"""``info`` and ``plot``: what a cube holds, in words and in pictures."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.base.text import print_json, print_pairs, print_table
from pounding_sweep.cli.app import ARGUMENTS, FIGURE_FILE, AsJson, At, axis_values, command
from pounding_sweep.cli.reporting import reporting, say

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.resume.survey import Survey


@command("info")
def info_command(
    cube: Annotated[
        Path,
        Argument(
            metavar="CUBE.nc",
            help="Cube made by 'run'; of one that is not finished, OUT.nc or its folder OUT.nc.parts will do.",
            show_default=False,
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Describe a cube: axes, variables, statuses, records; or what is done of one that is not finished."""
    with reporting():
        from pounding_sweep.output.describe import about, describe
        from pounding_sweep.output.netcdf import open_cube
        from pounding_sweep.resume.checkpoint import IDENTITY, parts_folder
        from pounding_sweep.resume.survey import survey

        parts = cube if os.path.isdir(cube) else parts_folder(cube)  # unlike Path's, no error in a closed folder
        alone = os.path.isdir(parts) and not os.path.isfile(cube)
        content, unfinished = None, survey(parts) if alone else None
        if not alone:
            with open_cube(cube) as dataset:
                content = about(dataset) if as_json else describe(dataset)
            if os.path.exists(parts / IDENTITY):
                try:
                    unfinished = survey(parts)
                except OutputError as error:
                    say(f"warning: {error}")
        if as_json:
            rest = unfinished and asdict(unfinished) | {"folder": str(unfinished.folder)}
            print_json({"cube": content, "unfinished": rest})
        elif content is not None:
            print(content, *([] if unfinished is None else [_sidecar(unfinished)]), sep="\n\n")
        elif unfinished is not None:
            _print_unfinished(unfinished)


def _sidecar(survey: Survey) -> str:
    """Say that a cube is older than a sweep that is not finished, and how much of that is done."""
    done, planned = (sum(getattr(part, name) for part in survey.parts) for name in ("scenarios_done", "scenarios"))
    most = planned if survey.planned else f"at most {survey.at_most}" if survey.at_most else "an unknown number of"
    state = f", {survey.now} is at work on it" if survey.now else ""
    return f"An unfinished run stands beside this cube, {done} of {most} scenarios done{state}: {survey.folder}"


def _print_unfinished(survey: Survey) -> None:
    """Print what is done and what is missing of a sweep."""
    state = f"{survey.now} is at work on it" if survey.now else "not running; run the same command to resume"
    rows = [("unfinished", str(survey.folder)), *([("title", survey.title)] if survey.title else [])]
    rows += [*survey.details.items(), ("state", state)]
    if survey.asked is None:
        rows.append(("scenarios", "no run came as far as its first stage"))
    else:
        rows.append(("scenarios", f"{survey.asked} asked, at most {survey.at_most} to run"))
        if not survey.planned:
            rows.append(("", "(which of them have to is known after the runs without pounding)"))
    print_pairs(rows)
    if survey.parts:
        print()
        headings = ["stage", "law", "record", "chunks", "done", "missing", "scenarios", "done", "missing"]
        cells = [
            [part.stage, part.law, part.record]
            + [str(n) for n in (part.chunks, part.chunks_done, part.chunks - part.chunks_done)]
            + [str(n) for n in (part.scenarios, part.scenarios_done, part.scenarios - part.scenarios_done)]
            for part in survey.parts
        ]
        print_table(headings, cells, right=range(3, 9))


@command("plot")
def plot_command(
    cube: Annotated[
        Path | None,
        Argument(metavar="CUBE.nc", help="Cube made by 'run', or another file made here.", show_default=False),
    ] = None,
    kind: Annotated[
        str | None, Argument(metavar="FIGURE", help="Figure; without it, figures are listed.", show_default=False)
    ] = None,
    out: Annotated[Path | None, Option("-o", "--output", metavar="FILE", help=FIGURE_FILE, show_default=False)] = None,
    at: At = None,
    x: Annotated[
        str | None, Option(metavar="AXIS", help="Axis of numbers to draw along, such as period_ratio.")
    ] = None,
    y: Annotated[str | None, Option(metavar="AXIS", help="Of a map, the other axis.")] = None,
    value: Annotated[
        str | None, Option(metavar="NAME", help="What to draw: a variable, or its amplification NAME_ratio.")
    ] = None,
    start: Annotated[float | None, Option(metavar="S", help="Of histories, the first instant drawn (s).")] = None,
    end: Annotated[float | None, Option(metavar="S", help="Of histories, the last instant (s).")] = None,
    contours: Annotated[bool, Option("--contours", help="Of a map, lines of equal value as well.")] = False,
    dpi: Annotated[float, Option(metavar="N", help="Dots per inch of a PNG.")] = 150.0,
    only_list: Annotated[bool, Option("--list", help="List the figures, and what of them CUBE.nc allows.")] = False,
    of_comparisons: Annotated[list[str] | None, Option(*ARGUMENTS, hidden=True)] = None,
) -> None:
    """Draw a figure of a cube into a file, or list the figures."""
    with reporting():
        if of_comparisons:
            raise InputError(
                f"{', '.join(ARGUMENTS)} are options of comparisons; give them to "
                "'pounding-sweep compare CUBE.nc -o FOLDER', which draws the figures as well"
            )
        from pounding_sweep.figures import FIGURES, SOURCES, plot
        from pounding_sweep.output.netcdf import open_cube

        if cube is None:
            if not only_list:
                raise InputError("a file is missing; give CUBE.nc FIGURE -o FILE, or --list for the figures there are")
            rows = [[figure.key, figure.title, SOURCES[figure.source]] for figure in FIGURES.values()]
            print_table(["figure", "shows", "drawn from"], rows)
            return
        with open_cube(cube) as dataset:
            chosen = _select(dataset, axis_values(at or []), kind)
            if only_list or kind is None:
                _print_figures(chosen)
            elif out is None:
                raise InputError(f"-o is missing; give the file to draw into, such as -o {kind}.png")
            else:
                settings: dict[str, Any] = {"x": x, "y": y, "value": value, "start": start, "end": end, "dpi": dpi}
                print(plot(chosen, kind, out, contours=contours or None, **settings))


def _select(dataset: xr.Dataset, values: dict[str, list[str]], kind: str | None) -> xr.Dataset:
    """Return those values of axes, or, of a comparison of the row as a whole, what it makes of them."""
    from pounding_sweep.analysis.comparisons import COMPARISONS, compared
    from pounding_sweep.analysis.scenarios import COMPARISON
    from pounding_sweep.figures import require
    from pounding_sweep.figures.select import SEVERAL
    from pounding_sweep.output.select import select
    from pounding_sweep.outputs.variables import INNER_DIMS

    chosen = select(dataset, values, INNER_DIMS)
    drawn = next((item for item in COMPARISONS.values() if item.figure == kind and item.whole), None)
    if drawn is not None and not {*INNER_DIMS}.isdisjoint(values) and COMPARISON not in dataset.attrs:
        require(chosen, drawn.figure)
        chosen = compared(dataset, drawn, values)
    for axis, texts in values.items():
        if len(texts) > 1 and axis in chosen.coords:
            chosen[axis].attrs[SEVERAL] = "yes"  # for figures that would draw one of them
    return chosen


def _print_figures(dataset: xr.Dataset) -> None:
    """Print which figures a dataset allows, and what the others lack."""
    from pounding_sweep.figures import FIGURES

    lacks = {kind.key: kind.missing(dataset) for kind in FIGURES.values()}
    possible = [[key, FIGURES[key].title] for key, missing in lacks.items() if not missing]
    others = [[key, ", ".join(missing)] for key, missing in lacks.items() if missing]
    if possible:
        print_table(["figure", "shows"], possible)
    if others:
        print()
        print_table(["not possible", "lacks"], others)
