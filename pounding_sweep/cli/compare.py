"""``compare``: what can be compared with a cube, and the comparisons themselves."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.analysis.comparisons import COMPARISONS, MOTION_DIMS, Row, compared, table_rows
from pounding_sweep.analysis.events import EVENTS, get_event
from pounding_sweep.base.tables import finite, number_text, print_json, print_pairs, print_table
from pounding_sweep.cli.app import ARGUMENTS, AsJson, At, CubeFile, Folders, Intensity, app, axis_values
from pounding_sweep.cli.reporting import reporting, say

if TYPE_CHECKING:
    import xarray as xr

#: Rows of each table in a summary.
SHOWN = 12
#: Event whose fragility is found where none is named.
DEFAULT_EVENT = "touch"

What = Annotated[
    list[str] | None,
    typer.Option(
        "--what",
        metavar="COMPARISON",
        help=f"One of: {', '.join(COMPARISONS)}; repeat for several. A summary of all that the cube allows by default.",
    ),
]


@app.command("compare")
def compare_command(
    cube: CubeFile,
    what: What = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FOLDER", help="Write tables (CSV), results (netCDF), figures."),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace tables and results that exist in FOLDER; figures always are.")
    ] = False,
    reference: Annotated[
        str | None, typer.Option("--reference", metavar="LAW", help="Law that the others are compared with.")
    ] = None,
    event: Annotated[
        str | None,
        typer.Option(
            "--event", metavar="EVENT", help=f"Of the fragility: {', '.join(EVENTS)}; {DEFAULT_EVENT} by default."
        ),
    ] = None,
    level: Annotated[
        float | None, typer.Option("--level", metavar="X", help="What the event must exceed, in its own unit.")
    ] = None,
    one_dispersion: Annotated[
        list[str] | None,
        typer.Option(
            "--one-dispersion",
            metavar="AXIS",
            help="Of the fragility: one dispersion for all curves along this axis, such as gap: they don't cross.",
        ),
    ] = None,
    at: At = None,
    over: Annotated[
        list[str] | None,
        typer.Option("--over", metavar="AXIS", help="Take all values of record, scale or pga together in tables."),
    ] = None,
    quantiles: Annotated[
        list[float] | None,
        typer.Option("--quantile", metavar="Q", help="Fractile of the values, 0 to 1; repeat for several."),
    ] = None,
    probabilities: Annotated[
        list[float] | None,
        typer.Option("--probability", metavar="P", help="Probability of touching, 0 to 1; repeat for several."),
    ] = None,
    intensity: Intensity = None,
    levels: Annotated[
        list[float] | None,
        typer.Option("--given", metavar="X", help="Intensity that gaps are for, in its unit; repeat for several."),
    ] = None,
    hazard: Annotated[
        str | None,
        typer.Option(
            "--hazard",
            metavar="CURVE",
            help="CSV file of intensities and annual rates of exceedance, or k0=RATE,kappa=SLOPE of k0 x^-kappa.",
        ),
    ] = None,
    hazard_units: Annotated[
        str | None,
        typer.Option("--hazard-units", metavar="UNIT", help="Of the intensities of --hazard: g, m/s2, cm/s2, m/s ..."),
    ] = None,
    years: Annotated[
        float | None,
        typer.Option("--years", metavar="N", help="Years of the probability with --hazard; 50 by default."),
    ] = None,
    folders: Folders = None,
    as_json: AsJson = False,
) -> None:
    """Compare laws, gaps, buildings and records of a cube."""
    given: dict[str, Any] = locals()
    with reporting():
        from pounding_sweep.analysis.along import check_quantiles
        from pounding_sweep.analysis.comparisons.gap_for_probability import PROBABILITIES, YEARS, check_numbers
        from pounding_sweep.analysis.hazard import hazard_of
        from pounding_sweep.analysis.intensity import check_intensity, intensity_of, with_intensity
        from pounding_sweep.analysis.scenarios import law_keys, pounding_only, scenario_dims
        from pounding_sweep.base.errors import InputError, unknown
        from pounding_sweep.output.netcdf import open_cube
        from pounding_sweep.output.provenance import plain
        from pounding_sweep.output.select import select

        keys = list(dict.fromkeys(what)) if what else list(COMPARISONS)
        for key in keys:
            if key not in COMPARISONS:
                raise InputError(unknown("comparison", key, COMPARISONS))
        asked = {option: given[name] for option, name in ARGUMENTS.items() if given[name] not in (None, [])}
        _check_options([option for option in asked if option != "--records" or intensity is None], keys)
        if hazard is None and (years is not None or hazard_units is not None):
            option = "--hazard-units" if years is None else "--years"
            msg = f"{option} are those of a hazard; add --hazard, or leave them out"
            raise InputError(msg)
        if quantiles:
            check_quantiles(quantiles)
        check_numbers(probabilities or PROBABILITIES, years=YEARS if years is None else years)
        if intensity is not None:
            check_intensity(intensity)
        if hazard is not None:
            asked["--hazard"] = hazard_of(hazard, hazard_units)
        wrong = [axis for axis in over or () if axis not in MOTION_DIMS]
        if wrong:
            raise InputError(unknown("axis to take together", wrong[0], MOTION_DIMS))
        values = axis_values(at or [])
        if any("event" in COMPARISONS[key].arguments for key in keys):
            get_event(event or DEFAULT_EVENT, level)
        if out is not None:
            _check_data(out, keys, overwrite)
        report: dict[str, dict[str, Any]] = {}
        with open_cube(cube) as found:
            laws = law_keys(pounding_only(found))
            if reference is not None and laws and reference not in laws:
                raise InputError(unknown("reference law", reference, laws))
            scenarios, left_out = _left_out(select(found, values))
            for key in keys:
                comparison = COMPARISONS[key]
                report[key] = {"title": comparison.title, "needs": comparison.needs, "possible": True}
                report[key]["left_out"] = left_out
                passed = {ARGUMENTS[o]: value for o, value in asked.items() if ARGUMENTS[o] in comparison.arguments}
                passed |= {} if what or out else comparison.summary
                if "over" in comparison.arguments and what:
                    apart = {"law", *MOTION_DIMS} - {*(over or ())}
                    passed["over"] = [dim for dim in scenario_dims(select(found, values)) if dim not in apart]
                try:
                    result = compared(found, comparison, values, **passed)
                except InputError as error:
                    if what:
                        raise
                    report[key] |= {"possible": False, "why_not": str(error)}
                    continue
                own = "quantiles" in comparison.arguments
                table: dict[str, Any] = {"over": over or (), "quantiles": None if own else quantiles or None}
                rows = table_rows(result, comparison, **table)
                if intensity is not None and "intensity" not in comparison.arguments and comparison.rows is None:
                    rows = with_intensity(rows, intensity_of(found, intensity, folders=folders or None), intensity)
                report[key] |= {"attributes": {str(k): finite(plain(v)) for k, v in result.attrs.items()}, "rows": rows}
                report[key]["lead"] = table_rows(result, comparison, lead=True, **table)
                if out is not None:
                    report[key]["files"] = _write(result, report[key]["rows"], key, out, overwrite)
        if as_json:
            print_json({key: {k: v for k, v in part.items() if k != "lead"} for key, part in report.items()})
        else:
            if left_out:
                told = ", ".join(f"{count} {label}" for label, count in left_out.items())
                print(f"{sum(left_out.values())} of {scenarios} scenarios are left out, as they are not ok: {told}\n")
            _print(report, str(cube), summary=not what)


def _check_options(given: list[str], keys: list[str]) -> None:
    """Raise `InputError` for an option that no comparison takes."""
    from pounding_sweep.base.errors import InputError

    for option in given:
        tables = option in ("--quantile", "--intensity")  # those of most comparisons have fractiles and intensities
        takers = [k for k, c in COMPARISONS.items() if ARGUMENTS[option] in c.arguments or (tables and c.rows is None)]
        if not set(takers) & set(keys):
            of = f"the comparison{'s' * (len(takers) > 1)} {', '.join(map(repr, takers))}"
            msg = f"{option} is for {of}; leave it out, or add --what {takers[0]}"
            raise InputError(msg)


def _left_out(cube: xr.Dataset) -> tuple[int, dict[str, int]]:
    """Count the scenarios of a cube, and by status those that no comparison takes: they are not ok."""
    from pounding_sweep.output.slabs import status_counts
    from pounding_sweep.outputs.variables import STATUS, Status

    if "status" not in cube.data_vars:
        return 0, {}
    labels = {int(status): status.label for status in STATUS}
    counts = status_counts(cube["status"])
    return cube["status"].size, {labels.get(code, f"code {code}"): n for code, n in counts.items() if code != Status.OK}


def _check_data(folder: Path, keys: list[str], overwrite: bool) -> None:
    """Raise `OutputError` where a table or a result is there already, before anything is computed or replaced."""
    from pounding_sweep.output.netcdf import check_output

    for path in (folder / f"{key}{suffix}" for key in keys for suffix in (".csv", ".nc")):
        if os.path.exists(path):  # Path.exists raises where the folder can't be read
            check_output(path, overwrite, netcdf=path.suffix == ".nc")


def _write(result: xr.Dataset, rows: list[Row], key: str, folder: Path, overwrite: bool) -> list[str]:
    """Write the table, the result and the figure of a comparison; returns the names of the files."""
    from pounding_sweep.base.errors import InputError, OutputError
    from pounding_sweep.base.files import replacing
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import write_cube

    table = folder / f"{key}.csv"
    headings = list(dict.fromkeys(name for row in rows for name in row))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, headings)
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        msg = f"can't write {str(table)!r} ({error.strerror or error}); give a folder that can be written to"
        raise OutputError(msg) from error
    files = [table, write_cube(result, folder / f"{key}.nc", overwrite)]
    if COMPARISONS[key].figure:
        try:
            files.append(plot(result, COMPARISONS[key].figure, folder / f"{key}.png"))
        except InputError as error:  # tables can say more than pictures
            say(f"no figure of {key}: {error}")
    return [str(file) for file in files]


def _print(report: dict[str, dict[str, Any]], cube: str, *, summary: bool) -> None:
    if summary:
        print(f"Comparisons of {cube}; all columns of one: --what COMPARISON")
        print_pairs([(key, part["title"]) for key, part in report.items() if part["possible"]], indent=2)
        if not all(part["possible"] for part in report.values()):
            print("Not possible with this cube")
            print_pairs([(key, part["why_not"]) for key, part in report.items() if not part["possible"]], indent=2)
    for number, (key, part) in enumerate(report.items()):
        if not part["possible"]:
            continue
        if summary or number:
            print()
        print(f"{key}: {part['title']}")
        for note in _NOTES:
            if note in part["attributes"]:
                print(f"  {note.replace('_', ' ')}: {_cell(part['attributes'][note])}")
        rows = part["lead"][:SHOWN] if summary else part["rows"]
        headings = list(dict.fromkeys(name for row in rows for name in row))
        numbers = [i for i, name in enumerate(headings) if any(isinstance(row.get(name), int | float) for row in rows)]
        if rows:
            print_table(headings, [[_cell(row.get(name)) for name in headings] for row in rows], right=numbers)
        else:
            print("  no values")
        more = (len(part["lead"]) if summary else len(rows)) - len(rows)
        if more:
            print(f"  and {more} more rows: --what {key}")
        for file in part.get("files", []):
            print(file)


#: Attributes of results that are told above their tables.
_NOTES = (
    "reference_law",
    "realised_basis",
    "largest_residual_relative",
    "over",
    "event_in_words",
    "intensity",
    "no_fractiles",
    "one_dispersion",
    "curves_cross",
    "hazard",
    "years",
    "confidence",
)


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else number_text(value)
