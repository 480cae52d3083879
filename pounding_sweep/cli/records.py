"""``records``: what is at hand, how strong it is, and how it looks."""

from __future__ import annotations

import itertools
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.files import read_data
from pounding_sweep.base.text import number_text, print_json, print_pairs, print_table
from pounding_sweep.cli import app
from pounding_sweep.cli.app import AsJson, Folders, Overwrite, argument, option, output, reporting, say

if TYPE_CHECKING:
    from pounding_sweep.records import Record

Column = Annotated[
    str | None, option("COLUMN", "Heading or number of the component, for files that have several.", default=...)
]

records_app = typer.Typer(rich_markup_mode=None)
app.app.add_typer(records_app, name="records")


@records_app.callback(invoke_without_command=True)
def records_command(
    context: typer.Context, folders: Folders = None, column: Column = None, as_json: AsJson = False
) -> None:
    """List the records at hand and the known ones missing."""
    if context.invoked_subcommand is not None:
        context.obj = folders, column
        return
    with reporting():
        from pounding_sweep.plan.sanity import record_doubts
        from pounding_sweep.records import NAMED_RECORDS, RECORD_SETS, Record, list_records, record_measures
        from pounding_sweep.records.catalogue import PEER, data_folder

        listed = dict(list_records(folders, column))
        records = {name: item for name, item in listed.items() if isinstance(item, Record)}
        errors = {name: item for name, item in listed.items() if not isinstance(item, Record)}
        installed = data_folder() is not None
        report = {
            "records": [
                {**read_as(record), "name": name, **asdict(record_measures(record))} for name, record in records.items()
            ],
            "unreadable": [{"name": name, "error": error} for name, error in errors.items()],
            "missing": [
                {"name": key, "description": text, "files": list(files), "place": f"{PEER}, RSN {rsn}"}
                for key, text, files, rsn in NAMED_RECORDS.values()
                if key not in listed
            ],
            "sets": [
                {"name": item.key, "title": item.title, "records": item.components, "installed": installed}
                for item in RECORD_SETS.values()
            ],
        }
        for text in [*errors.values(), *(text for record in records.values() for text in record_doubts(record))]:
            say(f"warning: {text}")
        if as_json:
            print_json(report)
        else:
            _print(report)


def read_as(record: Record) -> dict[str, Any]:
    """Return step, points and peak of a record, its unit in the file, and where each was read."""
    reading = record.reading
    return {
        "name": record.name,
        "points": record.n_points,
        "dt": record.dt,
        "pga_g": record.pga / STANDARD_GRAVITY,
        "scale": record.scale,
        **(asdict(reading) if reading else dict.fromkeys(("unit", "unit_from", "step_from", "column", "group"))),
        "read": str(reading or record.source or "not from a file"),
        "source": record.source,
    }


def print_read(rows: list[dict[str, Any]], missing: list[str], files: list[tuple[str, str]]) -> None:
    """Print what folders and patterns gave, and what was read of each record of a sweep; of very many the first."""
    lines, listed = list(files), 0
    for _, group in itertools.groupby(rows, lambda row: (row["group"], row["read"])):
        rows_of_kind = list(group)
        for part in [rows_of_kind] if len(rows_of_kind) >= 4 else [[row] for row in rows_of_kind]:
            if len(lines) - len(files) < 20:
                lines.append(_line(part))
                listed += len(part)
    if len(rows) > listed:
        lines.append(("...", f"and {len(rows) - listed} more records; --json has all"))
    if missing:
        lines.append(("left out", f"{', '.join(missing)}: no such record at hand"))
    print_pairs(lines)


def _line(rows: list[dict[str, Any]]) -> tuple[str, str]:
    """Return the line of one record, or of several that were read alike, of which it has the ranges."""
    points, dt, pga, scale = (
        " to ".join(dict.fromkeys(format(end(row[key] for row in rows), form) for end in (min, max)))
        for key, form in (("points", "d"), ("dt", "g"), ("pga_g", ".4g"), ("scale", ".4g"))
    )
    text = f"{points} points, dt {dt} s, PGA {pga} g{f' (scaled by {scale})' * (scale != '1')}; {rows[0]['read']}"
    if len(rows) == 1:
        return rows[0]["name"], text
    return f"{len(rows)} records", f"{rows[0]['name']} to {rows[-1]['name']}: {text}"


def _print(report: dict[str, Any]) -> None:
    from pounding_sweep.records import RECORDS_VARIABLE
    from pounding_sweep.records.catalogue import INSTALL

    columns = read_data("records.toml")["columns"]
    table = [
        [format(row[key], form) if form else number_text(row[key]) for key, form in columns.values()]
        for row in report["records"]
    ]
    print_table([*columns], table, right=range(1, 9))
    print()
    print_pairs([(row["name"], f"{row['source'] or '-'}; {row['read']}") for row in report["records"]])
    if report["missing"]:
        print(f"\nKnown by name, but not at hand; put the file into a folder named by {RECORDS_VARIABLE}:")
        rows = [[m["name"], m["description"], " or ".join(m["files"]), m["place"]] for m in report["missing"]]
        print_table(["record", "what", "file", "where to get it"], rows)
    installed = all(item["installed"] for item in report["sets"])
    print(f"\nSets of records{'' if installed else f', not installed: {INSTALL}'}")
    rows = [[item["name"], item["title"], str(item["records"])] for item in report["sets"]]
    print_table(["set", "what", "records"], rows, right=(2,))


@records_app.command("plot")
def plot_command(
    context: typer.Context,
    out: Path = output("FILE", app.FIGURE_FILE, default=...),
    names: list[str] | None = argument("NAME", "Records, files or sets; by default all at hand."),
    data: Path | None = option("MOTIONS.nc", "netCDF file for what is drawn."),
    overwrite: Overwrite = False,
    damping: float = option("RATIO", "Damping ratio of the spectra.", default=0.05),
    folders: Folders = None,
    column: Column = None,
) -> None:
    """Draw acceleration histories and response spectra of records."""
    with reporting():
        from pounding_sweep.analysis.spectra import response_spectrum
        from pounding_sweep.figures import plot
        from pounding_sweep.output.netcdf import check_output, write_cube
        from pounding_sweep.records import Record, list_records, records_dataset, resolve_records

        if data is not None:
            check_output(data, overwrite)
        where, column = folders or context.obj[0], column or context.obj[1]
        records = resolve_records(names or (), where, column=column)
        for _, item in () if names else list_records(where, column):
            if isinstance(item, Record):
                records.append(item)
            else:
                say(f"warning: {item}")
        motions = response_spectrum(records, damping_ratio=damping).merge(records_dataset(records))
        motions.attrs["title"] = "Ground motions and their response spectra"
        print(plot(motions, "ground-motion", out))
        if data is not None:
            write_cube(motions, data, overwrite)
            print(data)
