"""The report: one HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.files import replacing
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import package_version
from pounding_sweep.paper.compare import (
    ALL,
    HOLDS_SHARE,
    PARTLY_SHARE,
    RULE,
    Grid,
    agreement,
    energy_checks,
    findings,
    judge,
    opening_grid,
    side_by_side,
    table_grid,
    ungrouped,
    verdict_grid,
    verdict_of_all,
)
from pounding_sweep.paper.published import GROUND_MOTIONS, READINGS, RESCALED, STEP, TABLES, record_title
from pounding_sweep.paper.study import LIMIT, Study, error_text, largest_steps, step_grid


@dataclass(frozen=True)
class Picture:
    """A figure that was drawn into a file."""

    number: int  # number of the paper's figure that it stands for
    title: str  # what it shows
    path: Path  # PNG file; an SVG of the same name stands beside it


def write_report(contents: Mapping[str, Any], pictures: Sequence[Picture], path: Path) -> Path:
    """Write the report; `contents` are those of `contents_of`."""
    page = render(contents, pictures)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def render(contents: Mapping[str, Any], pictures: Sequence[Picture]) -> str:
    """Return the report as HTML; see `write_report`."""
    from jinja2 import Environment, StrictUndefined

    template = files("pounding_sweep").joinpath("paper", "report.html.j2").read_text("utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["base64"] = lambda path: base64.b64encode(path.read_bytes()).decode("ascii")
    return environment.from_string(template).render(**contents, pictures=pictures)


def contents_of(study: Study) -> dict[str, Any]:
    """Return everything that the report says, by section."""
    compared = {number: side_by_side(number, study.cube) for number in TABLES}
    readings = [READINGS[str(key)] for key in study.cube["reading"].values]
    judgements, suspects = judge(study.cube, study.floor_spectra), findings(study.cube)
    impossible = [f"{one.title}: {one.printed}" for one in suspects if one.impossible]
    return {
        "opening": verdict_of_all(compared, judgements, impossible),
        "rule": RULE,
        "version": package_version(),
        "how": _how(study.cube),
        "readings": readings,
        "missing": [(record_title(key), text) for key, text in study.missing.items()],
        "records": record_grid(study),
        "judgements": judgements,
        "labels": {key: reading.label for key, reading in READINGS.items()},
        "holds_share": f"{HOLDS_SHARE:.0%}",
        "partly_share": f"{PARTLY_SHARE:.0%}",
        "agreement": [agreement(one) for one in compared.values()],
        "tables": [table_grid(one) for one in compared.values()],
        "findings": suspects,
        "steps": [step_grid(study.steps, reading) for reading in readings],
        "largest_steps": largest_grid(study),
        "checks": checks_grid(study),
        "errors": error_grid(study),
        "hertz": hertz_grid(study),
    }


def summary(contents: Mapping[str, Any]) -> list[Grid]:
    """Return what a reader wants to know first, as tables: the verdict, and what it rests on."""
    by_table = dict(zip(TABLES, contents["agreement"], strict=True))
    rows = [[str(n), *row[:2], *row[3:]] for n, grid in by_table.items() for row in grid.rows if row[2] == ALL]
    headings = [("", "table"), *(pair for pair in by_table[3].headings if pair[1] != "record")]
    impossible = [[one.title, one.printed] for one in contents["findings"]]
    return [
        opening_grid(contents["opening"]),
        verdict_grid(contents["judgements"]),
        Grid("Agreement with Tables 3 to 6, over all records", headings, rows),
        contents["hertz"],
        Grid("What can't be", ungrouped("in the paper's tables", "printed"), impossible),
        contents["largest_steps"],
        contents["checks"],
        contents["errors"],
    ]


def record_grid(study: Study) -> Grid:
    """Write the ground motions beside Table 2."""
    used = {record.name: record for record in study.records}
    rows = []
    for key, (pga, duration) in GROUND_MOTIONS.items():
        if key not in used:
            rows.append([record_title(key), f"{pga:g}", "-", f"{duration:g}", "-", "missing"])
            continue
        record = used[key]
        note = f"scaled by {record.scale:.4f} to the paper's peak" if key in RESCALED else "as recorded"
        used_values = f"{record.pga / STANDARD_GRAVITY:.3f}", f"{duration:g}", f"{record.duration:.2f}"
        rows.append([record_title(key), f"{pga:g}", *used_values, note])
    groups = [("", "record"), *[(g, s) for g in ("PGA (g)", "duration (s)") for s in ("paper", "here")], ("", "")]
    return Grid("Ground motions (Table 2)", groups, rows)


def error_grid(study: Study) -> Grid:
    """Write the largest error of each output over all scenarios, reading by reading."""
    labels = [READINGS[str(key)].label for key in study.error["reading"].values]
    rows = []
    for name, error in study.error.data_vars.items():
        rows.append([str(name)])
        for reading in study.error["reading"].values:
            one = error.sel(reading=reading)
            worst = one.where(one == one.max(), drop=True)
            place = f"{LAWS[worst['law'].item(0)].model}, {record_title(worst['record'].item(0))}"
            place = place if float(one.max()) > 0 else "-"
            rows[-1] += [error_text(float(one.median())), error_text(float(one.max())), place]
    headings = [("", "output"), *[(label, text) for label in labels for text in ("median", "largest", "where")]]
    return Grid(f"Relative difference to a run with steps of at most {500.0 * STEP:g} ms", headings, rows)


def largest_grid(study: Study) -> Grid:
    """Write the largest step of each scheme that an engineer may take."""
    largest = 1e3 * largest_steps(study.steps)
    rows = []
    for scheme, located in product(largest["scheme"].values, largest["located"].values[::-1]):
        values = largest.sel(scheme=scheme, located=located).values
        rows.append([scheme, "yes" if located else "no", *(f"{v:g} ms" if np.isfinite(v) else "none" for v in values)])
    labels = (READINGS[str(key)].label for key in largest["reading"].values)
    title = f"Largest step with errors within {LIMIT:.0%} and the right number of impacts"
    return Grid(title, ungrouped("scheme", "contacts located", *labels), rows)


def checks_grid(study: Study) -> Grid:
    """Write the energy checks."""
    headings = ungrouped("what must be", "reading", "largest departure", "of", "relative")
    rows = [
        [
            one.text,
            READINGS[one.reading].label,
            f"{one.value:.2g} kN m",
            f"{one.scale:.0f} kN m",
            f"{one.value / one.scale:.1e}",
        ]
        for one in energy_checks(study.cube)
    ]
    return Grid("Energy", headings, rows)


def hertz_grid(study: Study) -> Grid:
    """Write how the forces of Models IV to VI compare with Table 5 under both Hertz stiffnesses."""
    headings = ungrouped("model", "floors in Table 5")
    stiffnesses = study.hertz["stiffness"].values
    columns = ("median ratio", "90 % over 10 % fractile")
    headings += [(f"{k:.3g} kN/m^1.5", text) for k in stiffnesses for text in columns]
    rows = []
    for law in study.hertz["law"].values:
        one = study.hertz.sel(law=law)
        rows.append([str(one["law_model"].item()), str(int(one["cells"].max()))])
        for k in stiffnesses:
            values = (float(one[name].sel(stiffness=k)) for name in ("force_ratio", "ratio_spread"))
            rows[-1] += [f"{value:.2f}" if np.isfinite(value) else "-" for value in values]
    return Grid("Computed peak force over that of Table 5", headings, rows)


def _how(cube: xr.Dataset) -> str:
    """Say how the cubes were integrated, as far as they agree."""
    attributes = cube.attrs
    if "method" not in attributes or "time_step" not in attributes:
        return "the cubes differ in scheme or step"
    located = "" if attributes.get("located") else "not "
    step = 1e3 * float(np.max(attributes["time_step"]))
    return f"{attributes['method']} with steps of at most {step:g} ms, contacts {located}located inside their steps"
