"""The report of a cube: one page that an engineer hands in, its tables for spreadsheets, its figures for A4."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import COMPARISONS, NOTES, Comparison, over_text, split_constant, table_rows
from pounding_sweep.analysis.comparisons.gaps import FROM_MEMORY
from pounding_sweep.analysis.rebuild import records_of, stored_scene, stored_sweep
from pounding_sweep.analysis.scenarios import long_name, scenario_dims, values
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError, check_choice, checked_arguments
from pounding_sweep.base.files import FilePath, expanded
from pounding_sweep.base.text import number_text
from pounding_sweep.figures import FIGURES
from pounding_sweep.figures.gallery.scenario import draw_at_rest
from pounding_sweep.figures.select import RESPONSES, describe, drawn_unit, law_name, record_name
from pounding_sweep.figures.style import unit_text
from pounding_sweep.output.audited import errors_sentence
from pounding_sweep.output.dataset import package_version
from pounding_sweep.output.describe import about, statuses
from pounding_sweep.output.netcdf import with_texts
from pounding_sweep.pages import Grid, ungrouped, write_page
from pounding_sweep.records import records_dataset
from pounding_sweep.records.synthetic import table_of
from pounding_sweep.request.toml import to_toml
from pounding_sweep.variables.registry import INNER_DIMS, VALID

#: Rows of a table at most, values of an axis that are listed, and dots per inch of figures.
_ROWS, _LISTED, _DPI = 60, 12, 160
#: Comparisons that stand first, others follow; further figures of some.
_FIRST = ("required-gap", "gap-for-probability", "amplification", "impacts", "fragility", "incremental")
_FURTHER = {"amplification": ("profiles",), "impacts": ("force-gap", "map")}
#: Outputs whose largest values are listed.
_LARGEST = (*RESPONSES, "impact_count", "penetration_max", "approach_speed_max", "impulse", "ductility_max")
#: Arguments of comparisons that tables of a page keep short.
_BRIEF = {"probabilities": (0.5, 0.1, 0.02)}
#: Parts of captions that are for the command line.
_HINTS = re.compile(r"[;,]? ?--at [^;]*|; hatched: info --status says why")


@dataclass
class Section:
    """A part of the page."""

    heading: str
    words: list[str] = field(default_factory=list)
    grids: list[Grid] = field(default_factory=list)
    pictures: list[tuple[str, bytes]] = field(default_factory=list)  # caption, PNG

    def add_table(self, title: str, headings: str, rows: list[list[str]]) -> None:
        """Add a table, if there are rows, of its columns that have values; headings are separated by ``|``."""
        names = headings.split("|")
        used = [i for i in range(len(names)) if any(row[i] for row in rows)]
        if rows:
            cells = [[row[i] for i in used] for row in rows]
            self.grids.append(Grid(title, ungrouped(*(names[i] for i in used)), cells))

    def draw(self, figure: Any, caption: str = "") -> None:
        """Add a figure without its title, which the caption says."""
        file, notes = BytesIO(), getattr(figure, "caption", [caption])
        figure.suptitle("")
        figure.savefig(file, format="png", dpi=_DPI)
        self.pictures.append((_HINTS.sub("", "; ".join(filter(None, notes))), file.getvalue()))


@checked_arguments
def report(cube: xr.Dataset, path: FilePath, *, title: str | None = None, folders: Any = None, **options: Any) -> Path:
    """Write the report of a cube: one HTML file that needs no other.

    It has the row, the ground motions with their spectra, and a section for each comparison that the cube allows, such
    as required gaps beside the rules of codes, amplification, contact forces and fragility; then how scenarios ended,
    errors, and how to compute the cube again. What is not possible is listed with the reason.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of a run.
    path : path
        The file, ``.html``; replaced if it exists.
    title : str, optional
        Title in place of the cube's.
    folders : path or several, optional
        Where to find records by name.
    **options
        Arguments of comparisons, such as ``behaviour`` of `pounding_sweep.analysis.required_gap`, or ``event``,
        ``level`` and ``hazard`` of `pounding_sweep.analysis.fragility`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The dataset is no cube, an option is none of any comparison, or the file is not ``.html``.

    Examples
    --------
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02]).run()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ps.report(cube, f"{folder}/report.html").name
    'report.html'
    """
    target = expanded(path)
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{str(path)!r} is no page; give a file that ends in .html")
    if "status" not in cube.data_vars:
        raise InputError("a report is of a cube of 'pounding-sweep run'; this file has no statuses of scenarios")
    for name in options:
        check_choice("option of a report", name, {name for item in COMPARISONS.values() for name in item.arguments})
    file, cube = Path(cube.encoding.get("source", "CUBE.nc")).name, with_texts(cube.load())
    sweep, valid = stored_sweep(cube), cube["status"].isin(VALID)
    cube = cube.assign({name: part.where(valid) for name, part in cube.items() if {*INNER_DIMS} & {*part.dims}})
    content, results, left_out = about(cube), dict[str, xr.Dataset](), list[tuple[str, str]]()
    sections = [_row(cube, content), _motions(cube, sweep, folders), _scenarios(cube, content)]
    for key in dict.fromkeys([*_FIRST, *COMPARISONS]):
        if key == "fractiles" and "incremental" in results:  # has them
            continue
        try:
            section, results[key] = _compare(cube, COMPARISONS[key], _BRIEF | {"folders": folders} | options)
            sections.append(section)
        except InputError as error:
            left_out.append((COMPARISONS[key].title, str(error)))
    return write_page(
        "pages/report.html.j2",
        target,
        title=title or content["title"] or "Seismic pounding",
        about=content,
        short=_short(cube, results),
        sections=[*sections, _endings(cube, content)],
        left_out=left_out,
        user_laws=sweep["user_laws"],
        file=file,
        toml=_sweep_file(sweep),
        digests=[(item["name"], item["sha256"]) for item in sweep["records"]],
        version=package_version(),
    )


def _sweep_file(sweep: dict[str, Any]) -> str:
    """Return the sweep file of a stored sweep, which finds records by name or makes them."""
    entries = []
    for item in sweep["records"]:
        made, span = table_of(item["source"]), (item["n_points"] - 1) * item["dt"]
        more = {"duration": span, "name": item["name"]} if made else {"record": item["name"], "scale": item["scale"]}
        entries.append((made or {}) | more)
    return to_toml(sweep, entries)


def _row(cube: xr.Dataset, content: dict[str, Any]) -> Section:
    """Draw the row, and list its numbers."""
    section, rows = Section("The row", ["Units are kN, t, m, s."]), []
    section.draw(draw_at_rest(cube))
    section.add_table("Buildings and pairs", "|what", [[*item.values()] for item in content["row"]])
    for item in stored_scene(cube).buildings:
        strengths = item.yield_strengths or (math.nan,) * item.n_storeys
        columns = item.elevations, item.masses, item.storey_stiffnesses, strengths
        for number, storey in enumerate(zip(*columns, strict=True), 1):
            rows.append([item.name, str(number), *("" if math.isnan(value) else f"{value:.6g}" for value in storey)])
    section.add_table("Storeys", "building|storey|elevation (m)|mass (t)|stiffness (kN/m)|yield strength (kN)", rows)
    return section


def _motions(cube: xr.Dataset, sweep: dict[str, Any], folders: Any) -> Section:
    """List the ground motions, with histories and spectra if the records are at hand."""
    section, rows = Section("Ground motions"), []
    names = {*np.atleast_1d(cube["record"].values).tolist()}
    for item in json.loads(cube.attrs["records"]):
        numbers = item["pga"] / STANDARD_GRAVITY, *map(item.get, ("pgv", "significant_duration", "duration", "dt"))
        if item["name"] in names:
            rows.append([record_name(item["name"]), *map(_cell, numbers), item["source"].partition(": ")[0]])
    headings = "record|PGA (g)|PGV (m/s)|significant duration (s)|duration (s)|dt (s)|source"
    section.add_table("As they are at scale 1", headings, rows)
    try:
        chosen = [item for item in sweep["records"] if item["name"] in names]
        records = records_of(sweep | {"records": chosen}, (), folders)
    except InputError as error:
        section.words.append(f"Histories and spectra are not drawn: {error}.")
        return section
    motions = response_spectrum(records).merge(records_dataset(records))
    section.draw(FIGURES["ground-motion"].draw(motions), "Acceleration histories and response spectra, 5 % damping")
    return section


def _scenarios(cube: xr.Dataset, content: dict[str, Any]) -> Section:
    """List axes and laws, and the largest value of each output with its scenario."""
    section, rows = Section("What was computed"), []
    for dim in scenario_dims(cube):
        axis = content["dims"][dim]
        step, joint = (1, ", ") if axis["size"] <= _LISTED else (axis["size"] - 1, " to ")
        which = joint.join(map(_cell, axis["values"][::step]))
        rows.append([dim, axis["long_name"], str(axis["size"]), axis["units"], which])
    section.add_table("Axes", "axis||values|unit|which", rows)
    if "law_formula" in cube.coords and cube["law"].dims == ("law",):
        laws = zip(cube["law"].values, cube["law_formula"].values, strict=True)
        rows = [[law_name(cube, law), str(formula)] for law, formula in laws]
        section.add_table("Contact laws: force (kN) of penetration d and its rate v", "law|force", rows)
    largest = {name: _largest(cube, name) for name in _LARGEST if name in cube}
    rows = [[long_name(cube[n], n), drawn_unit(cube[n].attrs)[0], *row] for n, row in largest.items() if row]
    section.add_table("Largest responses of all scenarios", "response|unit|largest|at|scenario", rows)
    return section


def _largest(cube: xr.Dataset, name: str) -> list[str]:
    """Return the largest value of a variable, where in the row it is, and in which scenario; nothing if none is."""
    part = values(cube, name)
    if not part.notnull().any():
        return []
    one = part.isel(part.argmax([*part.dims])).to_dataset(name="value")
    places = {dim: one[dim].item() for dim in INNER_DIMS if dim in part.dims}
    where = [f"storey {place}" if dim == "storey" else place for dim, place in places.items()]
    single = {str(dim): 1 for dim in part.dims if part.sizes[dim] == 1}
    return [_cell(one["value"].item() * drawn_unit(part.attrs)[1]), ", ".join(where), describe(one, single, INNER_DIMS)]


def _compare(cube: xr.Dataset, comparison: Comparison, arguments: dict[str, Any]) -> tuple[Section, xr.Dataset]:
    """Make the section of a comparison; raises `InputError` if the cube does not allow it."""
    key, section = comparison.key, Section(comparison.title[:1].upper() + comparison.title[1:])
    if key == "sensitivity":
        arguments = {"variables": [name for name in RESPONSES if name in cube][:1]} | arguments
    result = comparison.make(cube, **{name: item for name, item in arguments.items() if name in comparison.arguments})
    notes = {name.replace("_", " "): result.attrs[name] for name in NOTES if result.attrs.get(name)}
    section.words += [f"{name.capitalize()}: {_cell(note)}." for name, note in notes.items()]
    if key == "required-gap":
        _add_rules(section, result)
    else:
        folds = key in ("incremental", "fractiles") and "storey" in result.dims
        _add_tables(section, comparison, result.max("storey", keep_attrs=True) if folds else result)
    for figure, data in ((comparison.figure, result), *((further, cube) for further in _FURTHER.get(key, ()))):
        if figure and not FIGURES[figure].missing(data):
            try:
                section.draw(FIGURES[figure].draw(data.assign_attrs(title="")))  # which is above the page
            except InputError as error:
                section.words.append(f"No figure: {str(error).removesuffix('; choose others with --at')}.")
    return section, result


def _add_rules(section: Section, result: xr.Dataset) -> None:
    """Add a table of each pair: the exact required gap and those of rules, with where these are from."""
    section.words.append(
        "Nothing touches if every pair has its exact gap, the largest closing displacement of floors that could meet "
        "in the run without pounding. Rules know the largest displacement of each building alone; a ratio below 1 asks "
        "for less than the exact gap."
    )
    spread = over_text({dim: result.sizes[dim] for dim in result["exact"].dims if dim != "pair"})
    for pair in result["pair"].values:
        part = result.sel(pair=pair)
        rows = [["exact", "run without pounding", _cell(1e3 * part["exact"].max().item()), "", ""]]
        for rule in part["rule"].values:
            one = part.sel(rule=rule)
            texts = [one[f"rule_{name}"].item() for name in ("formula", "edition", "clause", "note")]
            numbers = 1e3 * one["rule_gap"].max(), one["ratio"].min(), one["ratio"].median()
            cells = [_cell(number.item()) for number in numbers]
            rows.append([one["rule_name"].item(), "; ".join(text for text in texts if text != "-"), *cells])
        of = f", the largest of {spread}" if spread != "-" else ""
        title = f"{pair}: required gap{of}; the row as described has {1e3 * part['row_gap'].item():g} mm"
        section.add_table(title, "|from|gap (mm)|smallest ratio|median ratio", rows)


def _add_tables(section: Section, comparison: Comparison, result: xr.Dataset) -> None:
    """Add the tables of a comparison, one for each of its variables."""
    printed = result.copy()
    for name in [*result, *({"row_gap"} & {*result.coords})]:
        if result[name].dtype.kind == "f":
            unit, factor = drawn_unit(result[name].attrs)
            printed[name] = (factor * result[name]).assign_attrs(result[name].attrs | {"units": unit or "1"})
    for key, group in groupby(table_rows(printed, comparison, lead=True), key=lambda row: row.get("variable")):
        table = [{name: value for name, value in row.items() if name != "variable"} for row in group]
        for row in table if "law" in table[0] else ():
            row["law"] = row["law"] and law_name(printed, row["law"])
        same, headings, _ = split_constant(table, numbers=False)
        unit, subject = same.pop("units", "1"), long_name(printed[key], key) if key in printed else comparison.title
        words = [f"{key}: {value}" for key, value in same.items() if value not in (None, "-")]
        title = "; ".join([f"{subject} ({unit})" if unit not in ("1", "") else subject, *words])
        if len(table) > _ROWS:
            where = f"'pounding-sweep compare --what {comparison.key} -o FOLDER' writes"
            section.words.append(f"{title}: {len(table)} rows, which {where}.")
            continue
        units = {key: unit_text(printed[key].attrs) for key in headings if key in printed.coords}
        labels = [f"{key.replace('_', ' ')}{f' ({units[key]})' if units.get(key) else ''}" for key in headings]
        section.add_table(title, "|".join(labels), [[_cell(row.get(key)) for key in headings] for row in table])


def _cell(value: Any) -> str:
    """Write a cell: nothing where there is no value."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return str(value) if isinstance(value, str) or math.isinf(value) else number_text(value)


def _endings(cube: xr.Dataset, content: dict[str, Any]) -> Section:
    """Say how scenarios ended, and how large the errors are."""
    sentence = errors_sentence(cube, cube.attrs) or "not measured in this cube"
    accuracy = cube.attrs.get("accuracy_choice", "none asked for")
    section = Section("How scenarios ended, and errors", [f"Accuracy: {accuracy}.", f"Errors: {sentence}."])
    where = {end["label"]: end["where"] for end in content["not_ok"]}
    ends = statuses(cube["status"], cube.get("unsettled_output", []))
    rows = [[e["label"], str(e["count"]), e["meaning"], e["remedy"], where.get(e["label"], "")] for e in ends]
    section.add_table("Scenarios by status", "status|scenarios|meaning|remedy|where", rows)
    return section


def _short(cube: xr.Dataset, results: dict[str, xr.Dataset]) -> list[str]:
    """Return the sentences at the top."""
    valid, total = int(cube["status"].isin(VALID).sum()), cube["status"].size
    lines = [f"{valid} of {total} scenarios have results" if valid else f"NO SCENARIO of {total} has results"]
    if "impact_force_max" in cube and (row := _largest(cube, "impact_force_max")):
        lines.append(f"Largest contact force: {row[0]} kN at {row[1]}, {row[2]}")
    if gaps := results.get("required-gap"):
        largest = 1e3 * gaps[["exact", "rule_gap"]].max([dim for dim in gaps["exact"].dims if dim != "pair"])
        codes = largest.isel(rule=largest["rule_note"].values == FROM_MEMORY)
        for pair in codes["pair"].values:
            part = codes.sel(pair=pair)
            asked = zip(part["rule_name"].values, part["rule_gap"].values.tolist(), strict=True)
            rules = ", ".join(f"{rule} asks for {_cell(gap)} mm" for rule, gap in asked)
            lines.append(f"{pair} needs a gap of {_cell(part['exact'].item())} mm to stay apart; {rules}")
    ratios = results.get("amplification", xr.Dataset())
    for name in COMPARISONS["amplification"].lead:
        if name in ratios and (row := _largest(ratios, name)):
            lines.append(f"{long_name(ratios[name], name).capitalize()}: up to {row[0]} times at {row[1]}, {row[2]}")
    return lines
