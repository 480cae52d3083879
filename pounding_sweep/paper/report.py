"""The report: tables as text, for the terminal and for one HTML page that needs no other file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import package_version
from pounding_sweep.pages import Grid, ungrouped, write_page
from pounding_sweep.paper import compare
from pounding_sweep.paper.compare import CLOSE, WRITTEN, findings, paper_and_computed, side_by_side, verdict_of_all
from pounding_sweep.paper.study import (
    GROUND_MOTIONS,
    LIMIT,
    READINGS,
    RESCALED,
    STEP,
    STEP_OUTPUTS,
    TABLES,
    Reading,
    Study,
    largest_steps,
    record_title,
)
from pounding_sweep.variables.registry import STATUS

_SOURCES = {"sap2000": "paper, SAP2000", "matlab": "paper, MATLAB", "paper": "paper"}
_SOURCES |= {key: reading.label for key, reading in READINGS.items()}
_LOCATED = {0: "no", 1: "yes"}
#: In place of a record, in summaries: all together.
ALL = "all"


#: A figure that was drawn: the number of the paper's figure, what it shows, and its PNG file; an SVG stands beside it.
Picture = tuple[int, str, Path]


def write_report(contents: Mapping[str, Any], pictures: Sequence[Picture], path: Path) -> Path:
    """Write the report as HTML; `contents` are those of `contents_of`."""
    images = [(number, title, file.read_bytes()) for number, title, file in pictures]
    return write_page("paper/report.html.j2", path, **contents, pictures=images)


def contents_of(study: Study) -> dict[str, Any]:
    """Return everything that the report says, by section."""
    compared = {number: side_by_side(number, study.cube) for number in TABLES}
    readings = [READINGS[str(key)] for key in study.cube["reading"].values]
    judgements, suspects = compare.judge(study.cube, study.histories["pseudo_acceleration"]), findings(study.cube)
    impossible = [f"{item['title']}: {item['printed']}" for item in suspects if item["impossible"]]
    attrs, method = study.cube.attrs, "the cubes differ in scheme or step"
    if {"method", "time_step"} <= attrs.keys():
        located = "" if attrs.get("located") else "not "
        step = f"steps of at most {1e3 * float(np.max(attrs['time_step'])):g} ms"
        method = f"{attrs['method']} with {step}, contacts {located}located inside their steps"
    return {
        "opening": verdict_of_all(compared, judgements, impossible),
        "limits": compare.LIMITS,
        "version": package_version(),
        "how": method,
        "readings": readings,
        "missing": [(record_title(key), text) for key, text in study.missing.items()],
        "records": _records_grid(study),
        "judgements": judgements,
        "labels": _SOURCES,
        "agreement": list(map(agreement, compared.values())),
        "tables": list(map(table_grid, compared.values())),
        "findings": suspects,
        "steps": [step_grid(study.steps, reading) for reading in readings],
        "largest_steps": _largest_grid(study.steps),
        "checks": _checks_grid(study.cube),
        "errors": _error_grid(study.error),
        "hertz": _hertz_grid(study.hertz),
    }


def summary(contents: Mapping[str, Any]) -> list[Grid]:
    """Return what a reader wants to know first, as tables: the verdict, and what it rests on."""
    verdict = [
        [part.word, part.reading, item] if item is part.items[0] else ["", "", item]
        for part in contents["opening"]
        for item in part.items
    ]
    claims = []
    for one in contents["judgements"]:
        label = READINGS[one.reading].label
        claims.append([one.conclusion["key"], label, one.verdict.value, "", one.conclusion["text"]])
        for claim, outcome in zip(one.conclusion["claims"], one.outcomes, strict=True):
            cases = f"{outcome.true_cases}/{outcome.cases}"
            claims.append(["", "", outcome.verdict.value, cases, f"{claim['text']} {outcome.numbers}"])
    by_table = zip(TABLES, contents["agreement"], strict=True)
    rows = [[str(n), *row[:2], *row[3:]] for n, grid in by_table for row in grid.rows if row[2] == ALL]
    headings = [("", "table"), *(pair for pair in contents["agreement"][0].headings if pair[1] != "record")]
    impossible = [[item["title"], item["printed"]] for item in contents["findings"]]
    claimed = ungrouped("", "reading", "verdict", "cases", "conclusion, and its claims with the numbers")
    return [
        Grid("The verdict", ungrouped("verdict", "reading", "what"), verdict),
        Grid("The paper's conclusions", claimed, claims),
        Grid("Agreement with Tables 3 to 6, over all records", headings, rows),
        contents["hertz"],
        Grid("What can't be", ungrouped("in the paper's tables", "printed"), impossible),
        *(contents[key] for key in ("largest_steps", "checks", "errors")),
    ]


def _number_texts(values: xr.DataArray, form: str) -> list[str]:
    """Write numbers; a hyphen where there is none."""
    return [f"{value:{form}}" if np.isfinite(value) else "-" for value in values.values.ravel()]


def _label(dim: str, value: Any) -> str:
    if dim == "law":
        return LAWS[value].model
    return record_title(value) if dim == "record" and value != ALL else str(value)


def table_grid(compared: xr.Dataset) -> Grid:
    """Write a table of `side_by_side` as text, one row per place."""
    places = [dim for dim in ("law", "record", "building", "pair", "storey") if dim in compared.dims]
    stacked = compared.stack(place=places)
    headings = ungrouped(*(dim.replace("law", "model") for dim in places))
    columns = [[_label(dim, value) for value in stacked[dim].values] for dim in places]
    for name, source in product((name for name in WRITTEN if name in compared), compared["source"].values.tolist()):
        label, factor, unit, digits = WRITTEN[name]
        group = f"{label} ({unit})" if unit else label
        headings.append((group, _SOURCES[source]))
        columns.append(_number_texts(factor * stacked[name].sel(source=source), f"z.{digits}f"))
        if source in READINGS:
            headings.append((group, "difference"))
            columns.append(_number_texts(stacked[f"{name}_difference"].sel(reading=source), "+.0%"))
    return Grid(str(compared.attrs["title"]), headings, list(zip(*columns, strict=True)))


def agreement(compared: xr.Dataset) -> Grid:
    """Sum up a table of `side_by_side`: how near each reading comes to the paper, over all records and by record."""
    headings = ungrouped("output", "reading", "record", "cells", "median difference")
    headings += [("cells that agree", f"within {share:.0%}") for share in CLOSE]
    rows = []
    readings, records = compared["reading"].values.tolist(), compared["record"].values.tolist()
    for name, reading, record in product((name for name in WRITTEN if name in compared), readings, [ALL, *records]):
        table = compared if record == ALL else compared.sel(record=record)
        difference = table[f"{name}_difference"].sel(reading=reading).values
        errors = np.abs(difference[np.isfinite(difference)])
        paper, computed, written = paper_and_computed(table, name, reading)
        one_zero = int((np.isfinite(computed) & ((paper != 0) != written)).sum())
        shares = [f"{int((errors <= share).sum())} of {errors.size}" for share in CLOSE]
        median = f"{np.median(errors):.0%}" if errors.size else "-"
        place = [WRITTEN[name][0], READINGS[reading].label, _label("record", record)]
        rows.append([*place, str(paper.size), median, *shares, str(one_zero)])
    title = f"Agreement with {compared.attrs['title'].partition(':')[0]}"
    return Grid(title, [*headings, ("", "zero in one of the two alone")], rows)


def _records_grid(study: Study) -> Grid:
    """Write the ground motions beside Table 2."""
    records = {record.name: record for record in study.records}
    rows = []
    for key, (pga, duration) in GROUND_MOTIONS.items():
        texts = ["-", "-", "missing"]
        if record := records.get(key):
            note = f"scaled by {record.scale:.4f} to the paper's peak" if key in RESCALED else "as recorded"
            texts = [f"{record.pga / STANDARD_GRAVITY:.3f}", f"{record.duration:.2f}", note]
        rows.append([record_title(key), f"{pga:g}", texts[0], f"{duration:g}", *texts[1:]])
    groups = [("", "record"), *product(("PGA (g)", "duration (s)"), ("paper", "here")), ("", "")]
    return Grid("Ground motions (Table 2)", groups, rows)


def step_grid(steps: xr.Dataset, reading: Reading) -> Grid:
    """Write the errors of a reading: one row per scheme, locating and step."""
    errors = steps.sel(reading=reading.key)
    rows = []
    for scheme, located, step in product(steps["scheme"].values, steps["located"].values[::-1], steps["step"].values):
        part = errors.sel(scheme=scheme, located=located, step=step)
        status = STATUS[int(part["status"])]
        texts = [_error_text(error) if status.has_values else "-" for error in part["error"].values.tolist()]
        rows.append([scheme, _LOCATED[located], f"{step * 1e3:g}", *texts, status.label.replace("_", " ")])
    outputs = (STEP_OUTPUTS[name] for name in steps["output"].values)
    headings = ungrouped("scheme", "contacts located", "step ms", *outputs, "status")
    return Grid(reading.label.capitalize(), headings, rows)


def _largest_grid(steps: xr.Dataset) -> Grid:
    """Write the largest step of each scheme that an engineer may take."""
    largest = 1e3 * largest_steps(steps)
    rows = []
    for scheme, located in product(largest["scheme"].values, largest["located"].values[::-1]):
        values = largest.sel(scheme=scheme, located=located).values
        rows.append([scheme, _LOCATED[located], *(f"{v:g} ms" if np.isfinite(v) else "none" for v in values)])
    labels = (_SOURCES[key] for key in largest["reading"].values)
    title = f"Largest step with errors within {LIMIT:.0%} and the right number of impacts"
    return Grid(title, ungrouped("scheme", "contacts located", *labels), rows)


def _checks_grid(cube: xr.Dataset) -> Grid:
    """Write the energy checks."""
    checks = compare.energy_checks(cube)
    rows = []
    for reading, check in product(checks["reading"].values, checks["check"].values):
        off, scale = (float(part) for part in checks.sel(reading=reading, check=check).data_vars.values())
        rows.append([check, _SOURCES[reading], f"{off:.2g} kN m", f"{scale:.0f} kN m", f"{off / scale:.1e}"])
    return Grid("Energy", ungrouped("what must be", "reading", "largest departure", "of", "relative"), rows)


def _error_grid(errors: xr.Dataset) -> Grid:
    """Write the largest error of each output over all scenarios, reading by reading."""
    rows = []
    for name, error in errors.data_vars.items():
        rows.append([str(name)])
        for one in error.stack(place=("law", "record")):
            law, record = one["place"].values[int(one.argmax("place"))]
            place = f"{LAWS[law].model}, {record_title(record)}" if one.max() > 0 else "-"
            rows[-1] += [_error_text(float(one.median())), _error_text(float(one.max())), place]
    labels = [_SOURCES[key] for key in errors["reading"].values]
    headings = [("", "output"), *product(labels, ("median", "largest", "where"))]
    return Grid(f"Relative difference to a run with steps of at most {500.0 * STEP:g} ms", headings, rows)


def _hertz_grid(hertz: xr.Dataset) -> Grid:
    """Write how the forces of Models IV to VI compare with Table 5 under both Hertz stiffnesses."""
    stiffnesses = [f"{stiffness:.3g} kN/m^1.5" for stiffness in hertz["stiffness"].values]
    headings = [*ungrouped("model", "floors in Table 5")]
    headings += product(stiffnesses, ("median ratio", "90 % over 10 % fractile"))
    ratios = hertz[["force_ratio", "ratio_spread"]].to_dataarray().transpose("law", "stiffness", "variable")
    laws = zip(hertz["law_model"].values, hertz["cells"].max("stiffness").values, ratios, strict=True)
    rows = [[str(model), str(cells), *_number_texts(values, ".2f")] for model, cells, values in laws]
    return Grid("Computed peak force over that of Table 5", headings, rows)


def _error_text(error: float) -> str:
    """Write a relative error: small ones as powers of ten, others in percent."""
    if error == 0.0:
        return "0"
    return f"{error:.1e}" if error < 0.01 else f"{error:.1%}"
