"""``info`` and ``plot``: what a cube holds, in words and in pictures."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.base.tables import print_json, print_pairs, print_table
from pounding_sweep.cli.app import ARGUMENTS, FIGURE_FILE, AsJson, At, app, axis_values
from pounding_sweep.cli.reporting import reporting, say

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.resume.survey import Survey


@app.command("info")
def info_command(
    cube: Annotated[
        Path,
        typer.Argument(
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
        if os.path.isdir(parts) and not os.path.isfile(cube):
            unfinished = survey(parts)
            if as_json:
                print_json({"cube": None, "unfinished": _as_json(unfinished)})
            else:
                _print_unfinished(unfinished)
            return
        with open_cube(cube) as found:
            told = about(found) if as_json else describe(found)
        beside = None
        if os.path.exists(parts / IDENTITY):
            try:
                beside = survey(parts)
            except OutputError as error:
                say(f"warning: {error}")
        if as_json:
            print_json({"cube": told, "unfinished": beside and _as_json(beside)})
        else:
            print(told)
            if beside is not None:
                print(f"\n{_beside(beside)}")


def _as_json(found: Survey) -> dict[str, Any]:
    """Return what there is of a sweep that is not finished as JSON holds it."""
    return asdict(found) | {"folder": str(found.folder)}


def _beside(found: Survey) -> str:
    """Say that a cube is older than a sweep that is not finished, and how much of that is done."""
    done, planned = (sum(getattr(part, name) for part in found.parts) for name in ("scenarios_done", "scenarios"))
    most = planned if found.planned else f"at most {found.at_most}" if found.at_most else "an unknown number of"
    state = f", {found.now} is at work on it" if found.now else ""
    return f"An unfinished run stands beside this cube, {done} of {most} scenarios done{state}: {found.folder}"


def _print_unfinished(found: Survey) -> None:
    """Print what is done and what is missing of a sweep."""
    at_work = f"{found.now} is at work on it" if found.now else "nobody; the same command goes on from here"
    rows = [("unfinished", str(found.folder)), *([("title", found.title)] if found.title else [])]
    rows += [*found.details.items(), ("now", at_work)]
    if found.asked is None:
        rows.append(("scenarios", "no run came as far as its first stage"))
    else:
        rows.append(("scenarios", f"{found.asked} asked, at most {found.at_most} to run"))
        if not found.planned:
            rows.append(("", "(which of them have to is known after the runs without pounding)"))
    print_pairs(rows)
    if found.parts:
        print()
        headings = ["stage", "law", "record", "chunks", "done", "missing", "scenarios", "done", "missing"]
        cells = [
            [part.stage, part.law, part.record]
            + [str(n) for n in (part.chunks, part.chunks_done, part.chunks - part.chunks_done)]
            + [str(n) for n in (part.scenarios, part.scenarios_done, part.scenarios - part.scenarios_done)]
            for part in found.parts
        ]
        print_table(headings, cells, right=range(3, 9))


@app.command("plot")
def plot_command(
    cube: Annotated[
        Path | None,
        typer.Argument(metavar="CUBE.nc", help="Cube made by 'run', or another file made here.", show_default=False),
    ] = None,
    kind: Annotated[
        str | None, typer.Argument(metavar="FIGURE", help="Figure; without it, figures are listed.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help=FIGURE_FILE, show_default=False)
    ] = None,
    at: At = None,
    x: Annotated[
        str | None, typer.Option("--x", metavar="AXIS", help="Axis of numbers to draw along, such as period_ratio.")
    ] = None,
    y: Annotated[str | None, typer.Option("--y", metavar="AXIS", help="Of a map, the other axis.")] = None,
    value: Annotated[
        str | None,
        typer.Option("--value", metavar="NAME", help="What to draw: a variable, or its amplification NAME_ratio."),
    ] = None,
    start: Annotated[
        float | None, typer.Option("--start", metavar="S", help="Of histories, the first instant drawn (s).")
    ] = None,
    end: Annotated[float | None, typer.Option("--end", metavar="S", help="Of histories, the last instant (s).")] = None,
    contours: Annotated[bool, typer.Option("--contours", help="Of a map, lines of equal value as well.")] = False,
    dpi: Annotated[float, typer.Option(metavar="N", help="Dots per inch of a PNG.")] = 150.0,
    only_list: Annotated[
        bool, typer.Option("--list", help="List the figures, and what of them CUBE.nc allows.")
    ] = False,
    compared_by: Annotated[list[str] | None, typer.Option(*ARGUMENTS, hidden=True)] = None,
) -> None:
    """Draw a figure of a cube into a file, or list the figures."""
    with reporting():
        if compared_by:
            msg = (
                f"{', '.join(ARGUMENTS)} are options of comparisons; give them to "
                "'pounding-sweep compare CUBE.nc -o FOLDER', which draws the figures as well"
            )
            raise InputError(msg)
        from pounding_sweep.figures import FIGURES, SOURCES, plot
        from pounding_sweep.output.netcdf import open_cube

        if cube is None:
            if not only_list:
                msg = "a file is missing; give CUBE.nc FIGURE -o FILE, or --list for the figures there are"
                raise InputError(msg)
            print_table(
                ["figure", "shows", "drawn from"], [[k.key, k.title, SOURCES[k.source]] for k in FIGURES.values()]
            )
            return
        with open_cube(cube) as found:
            chosen = _drawn(found, axis_values(at or []), kind)
            if only_list or kind is None:
                _list(chosen)
            elif out is None:
                msg = f"-o is missing; give the file to draw into, such as -o {kind}.png"
                raise InputError(msg)
            else:
                more = {"x": x, "y": y, "value": value, "contours": contours or None, "start": start, "end": end}
                print(plot(chosen, kind, out, dpi=dpi, **more))


def _drawn(dataset: xr.Dataset, values: dict[str, list[str]], kind: str | None) -> xr.Dataset:
    """Return those values of axes, or, of a comparison of the row as a whole, what it makes of them."""
    from pounding_sweep.analysis.comparisons import COMPARISONS, compared
    from pounding_sweep.analysis.scenarios import COMPARISON
    from pounding_sweep.figures import require
    from pounding_sweep.figures.shown import SEVERAL
    from pounding_sweep.output.select import select
    from pounding_sweep.outputs.variables import INNER_DIMS

    chosen = select(dataset, values, INNER_DIMS)
    of = next((item for item in COMPARISONS.values() if item.figure == kind and item.whole), None)
    if of is not None and not {*INNER_DIMS}.isdisjoint(values) and COMPARISON not in dataset.attrs:
        require(chosen, of.figure)
        chosen = compared(dataset, of, values)
    for axis, each in values.items():
        if len(each) > 1 and axis in chosen.coords:
            chosen[axis].attrs[SEVERAL] = "yes"  # for figures that would draw one of them
    return chosen


def _list(dataset: xr.Dataset) -> None:
    """Print which figures a dataset allows, and what the others lack."""
    from pounding_sweep.figures import FIGURES

    lacks = {kind.key: kind.lacks(dataset) for kind in FIGURES.values()}
    possible = [[key, FIGURES[key].title] for key, missing in lacks.items() if not missing]
    if possible:
        print_table(["figure", "shows"], possible)
    others = [[key, ", ".join(missing)] for key, missing in lacks.items() if missing]
    if others:
        print()
        print_table(["not possible", "lacks"], others)
