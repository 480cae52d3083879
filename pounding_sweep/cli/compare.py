"""``compare``: what can be compared with a cube, and the comparisons themselves."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.analysis import comparisons
from pounding_sweep.analysis.comparisons import COMPARISONS, MOTION_DIMS, Row, compared, split_constant, table_rows
from pounding_sweep.base.errors import InputError, check_choice
from pounding_sweep.base.text import finite, number_text, print_json, print_pairs, print_table, terminal_width
from pounding_sweep.cli.app import AsJson, At, CubeFile, Folders, axis_values, command, flag, option, output, say

if TYPE_CHECKING:
    import xarray as xr

#: Rows of each table in a summary, and of a whole one beyond which records, storeys and scales are taken together.
MOST_ROWS, MOST = 12, 200
#: Options whose flag is not the name of the argument of comparisons that they give.
_FLAGS = {"quantiles": "quantile", "probabilities": "probability", "levels": "given", "folders": "records"} | {
    "behaviour": "cd, --ie, --q, --r"
}
_FACTORS = ("cd", "importance", "q", "r")
#: Options that are for every comparison, or part of another one.
_COMMON = ("cube", "what", "out", "overwrite", "at", "over", "hazard_units", *_FACTORS)


@dataclass
class InputOptions:
    """What comparisons take, beside the cube."""

    cube: CubeFile
    at: At = None
    reference: str | None = option("LAW", "Law that the others are compared with.")
    event: str | None = option("EVENT", f"Of the fragility: {', '.join(comparisons.EVENTS)}; touch by default.")
    level: str | None = option("X", "What the event must exceed, in its own unit; of a drift ratio 0.01 or 1%.")
    one_dispersion: list[str] | None = option(
        "AXIS", "Of the fragility: one dispersion for all curves along this axis, such as gap: they don't cross."
    )
    probabilities: list[str] | None = option(
        "P", "Probability of touching: 0.01 or 1%; repeat for several.", "--probability"
    )
    intensity: str | None = option(
        "MEASURE",
        "Of the ground motion: pga, pgv, sa(PERIOD), sa(BUILDING) at its first period, or sa at those of all; "
        "what the records are scaled to by default.",
    )
    levels: list[float] | None = option(
        "X", "Intensity that gaps are for, in its unit or the hazard's; repeat for several.", "--given"
    )
    hazard: str | None = option(
        "CURVE",
        "CSV file of intensities and annual rates, or 'poe in 50 years', or k0=RATE,kappa=SLOPE of k0 x^-kappa.",
    )
    hazard_units: str | None = option("UNIT", "Of the intensities of --hazard: g, m/s2, cm/s2, m/s ...")
    years: float | None = option("N", "Years of the probability with --hazard; 50 by default.")
    cd: list[str] | None = option("[BUILDING=]X", "ASCE 7: Cd, only if the motion was divided by R; 1 by default.")
    importance: list[str] | None = option("[BUILDING=]X", "ASCE 7: factor Ie; 1 by default.", "--ie")
    q: list[str] | None = option("[BUILDING=]X", "Eurocode 8: q, only if the motion was divided by it; 1 by default.")
    r: list[str] | None = option("[BUILDING=]X", "IS 1893: R, only if the motion was divided by it; 1 by default.")
    folders: Folders = None

    def arguments(self, keys: Collection[str]) -> dict[str, Any]:
        """Return the arguments of these comparisons; raises `InputError` for options that won't do."""
        from pounding_sweep.analysis.comparisons.gaps import read_factors
        from pounding_sweep.analysis.hazard import hazard_of
        from pounding_sweep.analysis.rebuild import check_intensity
        from pounding_sweep.analysis.scenarios import INTERVALS, numbers_in

        options = {name: value for name, value in vars(self).items() if value is not None}
        arguments = {name: value for name, value in options.items() if name not in _COMMON}
        if factors := {name: options[name] for name in _FACTORS if name in options}:
            arguments["behaviour"] = read_factors(factors)
        for name, value in arguments.items():
            # tables of most comparisons have fractiles and intensities; the latter may need records
            tables = name in ("quantiles", "intensity") or (name == "folders" and self.intensity is not None)
            takers = [key for key, c in COMPARISONS.items() if name in c.arguments or (tables and not c.rows)]
            if not {*takers} & {*keys}:
                flag, of = _FLAGS.get(name, name.replace("_", "-")), ", ".join(map(repr, takers))
                raise InputError(
                    f"--{flag} is for the comparison{'s' * (len(takers) > 1)} {of}; leave it out, or add "
                    f"--what {takers[0]}"
                )
            if name in INTERVALS:
                numbers_in(INTERVALS[name], value, name)
        if self.hazard is None and (self.years is not None or self.hazard_units is not None):
            flag = "--hazard-units" if self.years is None else "--years"
            raise InputError(f"{flag} are those of a hazard; add --hazard, or leave them out")
        if self.intensity is not None:
            check_intensity(self.intensity)
        if self.hazard is not None:
            arguments["hazard"] = hazard_of(self.hazard, self.hazard_units)
        if "fragility" in keys:
            comparisons.get_event(self.event or "touch", self.level)
        return arguments


@dataclass
class CompareOptions(InputOptions):
    """What is compared, and how."""

    what: list[str] | None = option(
        "COMPARISON",
        f"One of: {', '.join(COMPARISONS)}; repeat for several. By default a summary of all that the cube allows.",
    )
    out: Path | None = output("FOLDER", "Write tables (CSV), results (netCDF), figures.")
    overwrite: bool = flag("--overwrite", "Replace tables and results that exist in FOLDER; figures always are.")
    over: list[str] | None = option("AXIS", "Take all values of record, scale or pga together in tables.")
    quantiles: list[float] | None = option("Q", "Fractile of the values, 0 to 1; repeat for several.", "--quantile")


@command("report")
def report_command(
    options: InputOptions,
    out: Path = output("REPORT.html", "The page; replaced if it exists.", default=...),
    title: str | None = option("TEXT", "Title in place of the cube's."),
) -> None:
    """Write the report of a cube, one HTML page: row, motions, gaps, forces, fragility, errors."""
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.output.select import select
    from pounding_sweep.pages.report import report

    arguments = options.arguments(COMPARISONS)
    with open_cube(options.cube) as cube:
        print(report(select(cube, axis_values(options.at)), out, title=title, **arguments))


@command("compare")
def compare_command(options: CompareOptions, as_json: AsJson = False) -> None:
    """Compare laws, gaps, buildings and records of a cube."""
    from pounding_sweep.analysis.scenarios import law_keys, pounding_only
    from pounding_sweep.output.describe import statuses
    from pounding_sweep.output.netcdf import check_output, open_cube
    from pounding_sweep.output.select import select
    from pounding_sweep.variables.registry import VALID

    at, out, keys = axis_values(options.at), options.out, list(dict.fromkeys(options.what or COMPARISONS))
    for name in keys:
        check_choice("comparison", name, COMPARISONS)
    for name in options.over or ():
        check_choice("axis to take together", name, MOTION_DIMS)
    arguments = options.arguments(keys)
    for path in (out / f"{key}{suffix}" for key in keys for suffix in (".csv", ".nc")) if out else ():
        if os.path.exists(path):  # Path.exists raises where the folder can't be read
            check_output(path, options.overwrite, netcdf=path.suffix == ".nc")
    with open_cube(options.cube) as cube:
        laws = law_keys(pounding_only(cube))
        if options.reference is not None and laws:
            check_choice("reference law", options.reference, laws)
        selection = select(cube, at)
        ends = statuses(selection.get("status", []))
        left_out = {row["label"]: row["count"] for row in ends if row["status"] not in VALID}
        report = {key: {"left_out": left_out} | _compare(cube, selection, key, at, arguments, options) for key in keys}
    if as_json:
        print_json({key: {k: v for k, v in part.items() if k != "lead"} for key, part in report.items()})
        return
    if left_out:
        listed = ", ".join(f"{count} {label}" for label, count in left_out.items())
        scenarios = sum(row["count"] for row in ends)
        print(f"{sum(left_out.values())} of {scenarios} scenarios are left out, as they are not ok: {listed}\n")
    _print(report, options.cube, summary=not options.what)


def _compare(
    cube: xr.Dataset,
    selection: xr.Dataset,
    key: str,
    at: dict[str, list[str]],
    arguments: dict[str, Any],
    options: CompareOptions,
) -> dict[str, Any]:
    """Make a comparison, and write it where that is asked for; returns what is told of it."""
    from pounding_sweep.analysis.rebuild import intensity_of
    from pounding_sweep.analysis.scenarios import scenario_dims
    from pounding_sweep.output.identity import plain

    comparison, what, over = COMPARISONS[key], options.what, options.over or ()
    part: dict[str, Any] = {"title": comparison.title, "needs": comparison.needs, "possible": True}
    settings = {name: value for name, value in arguments.items() if name in comparison.arguments}
    settings |= {} if what or options.out else {name: value or None for name, value in comparison.summary.items()}
    if "over" in comparison.arguments and what:
        split = {"law", *MOTION_DIMS} - {*over, "" if options.intensity else "record"}
        settings["over"] = [dim for dim in scenario_dims(selection) if dim not in split]
    try:
        result = compared(cube, comparison, at, **settings)
    except InputError as error:
        if what:
            raise
        return part | {"possible": False, "why_not": str(error)}
    quantiles = None if "quantiles" in comparison.arguments else options.quantiles
    strength = None
    if options.intensity is not None and "intensity" not in comparison.arguments and not comparison.rows:
        strength = intensity_of(cube, options.intensity, folders=options.folders)
        strength = strength.squeeze(drop=True).rename(f"{options.intensity} {strength.attrs['units']}")
    part["attributes"] = {str(name): finite(plain(value)) for name, value in result.attrs.items()}
    part["rows"] = table_rows(result, comparison, over=over, quantiles=quantiles, intensity=strength)
    part["lead"] = part["rows"] if what else table_rows(result, comparison, lead=True, over=over, quantiles=quantiles)
    for dims in (("record",), ("record", "storey"), (*MOTION_DIMS, "storey")) if not over and strength is None else ():
        if len(part["lead"]) > MOST:
            part["lead"] = table_rows(result, comparison, over=dims, quantiles=quantiles)
    if options.out is not None:
        part["files"] = _write(result, part["rows"], comparison.figure, options.out / key, options.overwrite)
    return part


def _write(result: xr.Dataset, rows: list[Row], figure: str, stem: Path, overwrite: bool) -> list[str]:
    """Write the table, the result and the figure of a comparison, and its caption; returns the names of the files."""
    from pounding_sweep.base.files import replacing
    from pounding_sweep.base.text import CSV_NUMBER
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import write_cube

    table, cube, picture, caption = (stem.with_suffix(suffix) for suffix in (".csv", ".nc", ".png", ".txt"))
    stem.parent.mkdir(parents=True, exist_ok=True)
    with replacing(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, dict.fromkeys(itertools.chain(*rows)))
        writer.writeheader()
        writer.writerows({k: CSV_NUMBER % v if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    files = [table, write_cube(result, cube, overwrite)]
    if figure:
        try:
            files += [plot(result, figure, picture, caption=caption), caption]
        except InputError as error:  # tables can say more than pictures
            say(f"no figure of {stem.name}: {error}")
    return [str(file) for file in files]


def _print(report: dict[str, dict[str, Any]], cube: Path, *, summary: bool) -> None:
    possible = {key: part for key, part in report.items() if part["possible"]}
    if summary:
        print(f"Comparisons of {cube}; all columns of one: --what COMPARISON")
        print_pairs([(key, part["title"]) for key, part in possible.items()], indent=2)
        if len(possible) < len(report):
            print("Not possible with this cube")
            print_pairs([(key, part["why_not"]) for key, part in report.items() if key not in possible], indent=2)
    for number, (key, part) in enumerate(possible.items()):
        print("\n" * (summary or number > 0) + f"{key}: {part['title']}")
        rows = part["lead"][: MOST_ROWS if summary else None]
        for name in comparisons.NOTES:
            if part["attributes"].get(name):
                print(f"  {name.replace('_', ' ')}: {_cell(part['attributes'][name])}")
        if rows:
            _print_rows(rows)
        else:
            print("  no values")
        if more := len(part["lead"]) - len(rows):
            print(f"  and {more} more rows: --what {key}")
        if not summary and len(rows) < len(part["rows"]):
            print(f"  summary of {len(part['rows'])} rows: choose with --at and --over, or write all with -o FOLDER")
        for file in part.get("files", ()):
            print(file)


def _print_rows(rows: list[Row], split: bool = False) -> None:
    """Print a table, and above it what is the same in all rows; variables `apart` if it is wider than the terminal."""
    same, headings, numeric = split_constant(rows, numbers=split)
    cells = [[_cell(row.get(name)) for name in headings] for row in rows]
    width = sum(max(map(len, column)) + 2 for column in zip(headings, *cells, strict=True)) - 2
    if width > terminal_width() and not split:
        for number, (_, group) in enumerate(itertools.groupby(rows, lambda row: row.get("variable"))):
            print("\n" * bool(number), end="")
            _print_rows(list(group), split=True)
        return
    notes = [f"{name}: {_cell(value)}" for name, value in same.items() if value not in (None, "-")]
    if notes:
        print(f"  {'; '.join(notes)}")
    print_table(headings, cells, [i for i, name in enumerate(headings) if name in numeric])


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else number_text(value)
