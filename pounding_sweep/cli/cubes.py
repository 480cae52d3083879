"""Cubes: ``info`` and ``plot``, ``export`` to other formats, ``merge`` of those of one study."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.base.text import print_json, print_pairs, print_table, terminal_width
from pounding_sweep.cli import app
from pounding_sweep.cli.app import At, CubeFile, Folders, Overwrite, argument, command, flag, option, output, say

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.resume import Survey


@command("info")
def info_command(
    cube: Path = argument(
        "CUBE.nc",
        "Cube made by 'run'; of one that is not finished, OUT.nc or its folder OUT.nc.parts will do.",
        default=...,
    ),
    as_json: app.AsJson = False,
    status: bool = flag("--status", "Only the scenarios that are not ok, counted by value of each axis."),
) -> None:
    """Describe a cube: axes, variables, statuses, records; or what is done of one that is not finished."""
    from pounding_sweep.output.describe import about, describe
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.resume import MANIFEST, parts_folder, survey

    parts = cube if os.path.isdir(cube) else parts_folder(cube)  # unlike Path's, no error in a closed folder
    content = unfinished = None
    if os.path.isdir(parts) and not os.path.isfile(cube):
        unfinished = survey(parts)
    else:
        with open_cube(cube) as dataset:
            if status and not as_json:
                failed = about(dataset)
                number = sum(end["count"] for end in failed["not_ok"])
                print(f"{number} of {failed['scenarios']} scenarios are not ok")
                for end in failed["not_ok"]:
                    print("\n{count} {label}: {meaning}: {remedy}\n  {where}\n".format(**end))
                    rows = [[*map(str, row.values())] for row in end["by_value"]]
                    print_table(["axis", "value", end["label"], "of"], rows, right=(2, 3))
                return
            content = about(dataset) if as_json else describe(dataset, terminal_width())
        try:
            unfinished = survey(parts) if os.path.exists(parts / MANIFEST) else None
        except OutputError as error:
            say(f"warning: {error}")
    if as_json:
        rest = unfinished and asdict(unfinished) | {"folder": str(unfinished.folder)}
        print_json({"cube": content, "unfinished": rest})
        return
    if content is not None:
        print(content)
    if content is not None and unfinished is not None:
        print("\nAn unfinished run stands beside this cube:")
    if unfinished is not None:
        _print_unfinished(unfinished)


def _print_unfinished(survey: Survey) -> None:
    """Print what is done and what is missing of a sweep."""
    state = f"{survey.now} is at work on it" if survey.now else "not running; run the same command to resume"
    asked = f"{survey.asked} asked, at most {survey.at_most} to run"
    if survey.asked is None:
        asked = "no run came as far as its first stage"
    rows = [("unfinished", str(survey.folder)), *([("title", survey.title)] if survey.title else [])]
    rows += [*survey.details.items(), ("state", state), ("scenarios", asked)]
    if survey.asked is not None and not survey.planned:
        rows.append(("", "(which of them have to is known after the runs without pounding)"))
    print_pairs(rows)
    cells = []
    for part in survey.parts:
        counts = (part.chunks, part.chunks_done), (part.scenarios, part.scenarios_done)
        numbers = (str(number) for total, done in counts for number in (total, done, total - done))
        cells.append([part.stage, part.law, part.record, *numbers])
    if cells:
        print()
        headings = ["stage", "law", "record", "chunks", "done", "missing", "scenarios", "done", "missing"]
        print_table(headings, cells, right=range(3, 9))


@dataclass
class FigureOptions:
    """Options of figures, under the names that `figures.plot` knows them by."""

    x: str | None = option("AXIS", "Axis of numbers to draw along, such as period_ratio.")
    y: str | None = option("AXIS", "Of a map, the other axis.")
    value: str | None = option("NAME", "What to draw: a variable, or its amplification NAME_ratio.")
    event: str | None = option("EVENT", "Of a fragility, such as drift; touch by default.")
    level: str | None = option("X", "What the event must exceed, in its own unit; of a drift ratio 0.01 or 1%.")
    start: float | None = option("S", "Of histories, the first instant drawn (s).")
    end: float | None = option("S", "Of histories, the last instant (s).")
    contours: bool = flag("--contours", "Of a map, lines of equal value as well.")
    turn: bool = flag("--turn", "Of incremental, the intensity across.")
    names: bool = flag("--names", "Of incremental, name the records.")
    dpi: float = option("N", "Dots per inch of a PNG.", default=150.0)
    title: str | None = option("TEXT", "Title in place of the figure's own.")
    caption: Path | None = option("FILE", "Text file for what the figure shows: values of axes, records, laws.")
    units: str = option("UNIT", "Of accelerations: g, or m/s2.", default="m/s2")


@command("plot")
def plot_command(
    cube: Path | None = argument("CUBE.nc", "Cube made by 'run', or another file made here."),
    kind: str | None = argument("FIGURE", "Figure; without it, figures are listed."),
    out: Path | None = output("FILE", app.FIGURE_FILE),
    at: At = None,
    *,
    options: FigureOptions,
    no_title: bool = flag("--no-title", "No title, as above a caption of your own."),
    only_list: bool = flag("--list", "List the figures, and what of them CUBE.nc allows."),
) -> None:
    """Draw a figure of a cube into a file, or list the figures."""
    from pounding_sweep.figures import FIGURES, SOURCES, plot
    from pounding_sweep.output.netcdf import open_cube

    if cube is None:
        if not only_list:
            raise InputError("a file is missing; give CUBE.nc FIGURE -o FILE, or --list for the figures there are")
        rows = [[figure.key, figure.title, SOURCES[figure.source]] for figure in FIGURES.values()]
        print_table(["figure", "shows", "drawn from"], rows)
        return
    with open_cube(cube) as dataset:
        chosen = _select(dataset, app.axis_values(at), kind)
        if only_list or kind is None:
            missing = {figure: ", ".join(figure.missing(chosen)) for figure in FIGURES.values()}
            if possible := [[figure.key, figure.title] for figure, names in missing.items() if not names]:
                print_table(["figure", "shows"], possible)
            if others := [[figure.key, names] for figure, names in missing.items() if names]:
                print()
                print_table(["not possible", "lacks"], others)
        elif out is None:
            raise InputError(f"-o is missing; give the file to draw into, such as -o {kind}.png")
        else:
            settings = vars(options) | ({"title": ""} if no_title else {})
            print(plot(chosen, kind, out, report=say, **settings))


def _select(dataset: xr.Dataset, values: dict[str, list[str]], kind: str | None) -> xr.Dataset:
    """Return those values of axes, or, of a comparison of the row as a whole, what it makes of them."""
    from pounding_sweep.analysis.comparisons import COMPARISONS, compared
    from pounding_sweep.analysis.scenarios import COMPARISON
    from pounding_sweep.figures import require
    from pounding_sweep.output.select import select
    from pounding_sweep.variables.registry import INNER_DIMS

    chosen = select(dataset, values, INNER_DIMS)
    drawn = next((item for item in COMPARISONS.values() if item.figure == kind and item.whole), None)
    if drawn is not None and not {*INNER_DIMS}.isdisjoint(values) and COMPARISON not in dataset.attrs:
        require(chosen, drawn.figure)
        chosen = compared(dataset, drawn, values)
    return chosen


@command("view")
def view_command(
    cube: CubeFile,
    out: Path | None = output("FILE.html", "Page to write, CUBE.html here by default; replaced if it exists."),
    names: list[str] | None = option("NAME", "Only this variable; repeat for several.", "--var"),
    at: At = None,
) -> None:
    """Write a page of a cube for any browser: sliders, lines, maps, the row, and each scenario with its command."""
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.pages.view import view

    with open_cube(cube) as dataset:
        print(view(dataset, out, at=app.axis_values(at), names=names))


@command("export")
def export_command(
    cube: CubeFile,
    out: Path = output("FILE", "What to write: .csv, .parquet or .zarr.", default=...),
    names: list[str] | None = option("NAME", "Only this variable; repeat for several.", "--var"),
    at: At = None,
    table: bool = flag(
        "--table", "One row per scenario: inputs, measures of its record, all outputs, status, audited errors."
    ),
    status: list[str] | None = option(
        "STATUS", "Of a table, only scenarios that ended so, such as diverged, or not-ok; repeat for several."
    ),
    constants: bool = flag("--constants", "Masses, stiffnesses, periods and elevations of the row as columns, too."),
    units: bool = flag("--units", "Second line of a CSV file: the unit of each column."),
    limit_states: list[str] | None = option(
        "NAME=EVENT[:LEVEL]",
        "Of a fragility (.xml, OpenQuake NRML): touch=touch, severe=drift:0.03; repeat, the mildest first.",
        "--limit-state",
    ),
    intensities: list[str] | None = option(
        "MEASURE",
        "Of a table, a column more, repeat for several; of a fragility, its intensity: pga, pgv, sa(PERIOD), "
        "sa(BUILDING) at its first period, or sa at those of all.",
        "--intensity",
    ),
    folders: Folders = None,
    pelicun: str | None = option("BUILDING", "Demands of this building, as Pelicun (FEMA P-58) reads CSV."),
    overwrite: Overwrite = False,
) -> None:
    """Write a cube, or a part of it, as a table (CSV, Parquet) or as Zarr, or for OpenQuake or Pelicun."""
    from pounding_sweep.analysis.exchange import export_nrml, export_pelicun, falls_of
    from pounding_sweep.analysis.rebuild import with_intensities
    from pounding_sweep.output.export import export_tables
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.output.select import select
    from pounding_sweep.variables.registry import INNER_DIMS

    fragility = out.suffix.lower() == ".xml"
    of_cube = not fragility and pelicun is None
    layout = {"table": table, "status": status or (), "constants": constants, "units": units}
    for name, value, fits, what in (
        ("limit-state", limit_states, fragility, "a fragility; give -o FILE.xml"),
        ("intensity", intensities, fragility or table, "a fragility or --table; give -o FILE.xml or --table"),
        ("records", folders, fragility or table, "a fragility or --table; give -o FILE.xml or --table"),
        *(
            (name, value, of_cube, "tables of the cube itself; give -o FILE.csv")
            for name, value in {"var": names, **layout}.items()
        ),
    ):
        if value and not fits:
            raise InputError(f"--{name} is for {what}, or leave it out")
    measures = intensities or []
    if fragility and len(measures) > 1:
        raise InputError(f"--intensity is given {len(measures)} times, and a fragility is of one")
    with open_cube(cube) as dataset:
        values = app.axis_values(at)
        # a table shows part of the row, and its scenarios are known by the whole one
        parts = {axis: values.pop(axis) for axis in [*values] if table and axis in INNER_DIMS}
        part = select(dataset, values)
        paths: list[Any] = [out]
        if pelicun is not None:
            samples = export_pelicun(part, out, pelicun, overwrite=overwrite)
            falls = int(falls_of(part, pelicun).sum())
            others = f", in {falls} of which ({falls / samples:.0%}) it falls: 1-COLLAPSE-0-1 is 1" if falls else ""
            others += f"; {n} scenarios are left out" if (n := part["status"].size - samples) else ""
            say(f"{samples} samples of building {pelicun}{others}")
        elif fragility:
            named = (text.partition("=")[::2] for text in limit_states or ["touch=touch"])  # NAME=EVENT[:LEVEL]
            states = {name: (event.partition(":")[0], event.partition(":")[2] or None) for name, event in named}
            measure = next(iter(measures), None)
            skipped = export_nrml(part, out, states, overwrite=overwrite, intensity=measure, folders=folders)
            for name, why in skipped.items():
                say(f"warning: {name} is left out: {why}")
        else:
            part = with_intensities(part, measures, folders=folders)
            paths = export_tables(part, out, names or (), overwrite=overwrite, parts=parts, **layout)
        print(*paths, sep="\n")


@command("merge")
def merge_command(
    cubes: list[Path] = argument("A.nc B.nc ...", "Cubes of one study.", default=...),
    out: Path = output("ALL.nc", "netCDF file for the whole cube.", default=...),
    tolerance: float = option(
        "RATIO",
        "Difference of two results of a scenario, relative to the variable's largest value in it, that is no conflict.",
        default=1e-6,
    ),
    mix_sources: bool = flag(
        "--mix-sources",
        "Allow cubes made by several states of one version's source, or with several versions of numba, "
        "llvmlite or numpy; each is named in the cube.",
    ),
    overwrite: Overwrite = False,
) -> None:
    """Put cubes of one study together: same scene, numerics and outputs, other values on the axes or other cases."""
    from pounding_sweep.output.merge import merge_cubes

    merged = merge_cubes(cubes, out, overwrite=overwrite, tolerance=tolerance, mix_sources=mix_sources)
    overlap = f"{merged.scenarios}, {merged.overlapping} of them in several cubes"
    rows = [("cubes", str(len(cubes))), ("scenarios", overlap)]
    if merged.missing:
        more = ", ..." if merged.missing > len(merged.named) else ""
        rows.append(("missing", f"{merged.missing} (status not_run): {', '.join(merged.named)}{more}"))
    if merged.sources > 1:
        rows.append(("sources", f"{merged.sources}, by source, numba, llvmlite and numpy (see merged_from)"))
    print_pairs(rows)
    print(merged.path)
