"""The report: one HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.files import replacing
from pounding_sweep.base.gravity import STANDARD_GRAVITY
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import package_version
from pounding_sweep.paper.checks import energy_checks, findings
from pounding_sweep.paper.compare import ALL, Grid, agreement, side_by_side, table_grid
from pounding_sweep.paper.conclusions import HOLDS_SHARE, PARTLY_SHARE, Judgement, judge
from pounding_sweep.paper.published import GROUND_MOTIONS, TABLES, record_title
from pounding_sweep.paper.readings import READINGS, RESCALED, STEP
from pounding_sweep.paper.steps import LIMIT, error_text, largest_steps, step_rows
from pounding_sweep.paper.study import Study
from pounding_sweep.paper.verdict import Reproduction, opening_grid, rule, verdict_of_all


@dataclass(frozen=True)
class Picture:
    """A figure that was drawn into a file."""

    number: int  # number of the paper's figure that it stands for
    title: str  # what it shows
    path: Path  # PNG file; an SVG of the same name stands beside it


def write_report(study: Study, pictures: Sequence[Picture], path: Path) -> Path:
    """Write the report."""
    page = render(study, pictures)
    try:
        with replacing(path) as temporary:
            temporary.write_text(page, encoding="utf-8")
    except OSError as error:
        msg = f"can't write {str(path)!r} ({error.strerror or error}); free some space or give another folder"
        raise OutputError(msg) from error
    return path


def render(study: Study, pictures: Sequence[Picture]) -> str:
    """Return the report as HTML; see `write_report`."""
    from jinja2 import Environment, StrictUndefined

    template = files("pounding_sweep").joinpath("paper", "report.html.j2").read_text("utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(template).render(**contents(study), pictures=[_embedded(p) for p in pictures])


def contents(study: Study) -> dict[str, Any]:
    """Return everything that the page says, by section."""
    compared = {number: side_by_side(number, study.cube) for number in TABLES}
    readings = [READINGS[str(key)] for key in study.cube["reading"].values]
    return {
        "opening": opening(study),
        "rule": rule(),
        "version": package_version(),
        "how": _how(study.cube),
        "readings": readings,
        "missing": [(record_title(key), text) for key, text in study.missing.items()],
        "records": record_grid(study),
        "judgements": judge(study.cube, study.floor_spectra),
        "labels": {key: reading.label for key, reading in READINGS.items()},
        "holds_share": f"{HOLDS_SHARE:.0%}",
        "partly_share": f"{PARTLY_SHARE:.0%}",
        "agreement": [agreement(number, one) for number, one in compared.items()],
        "tables": [table_grid(number, one) for number, one in compared.items()],
        "findings": findings(study.cube),
        "steps": [Grid(r.label.capitalize(), *_headed(step_rows(study.steps, r.key))) for r in readings],
        "largest_steps": largest_grid(study),
        "checks": checks_grid(study),
        "errors": error_grid(study),
        "hertz": hertz_grid(study),
        "header_groups": header_groups,
    }


def opening(study: Study) -> list[Reproduction]:
    """Return the verdict that the report opens with."""
    compared = {number: side_by_side(number, study.cube) for number in TABLES}
    return verdict_of_all(study.cube, compared, judge(study.cube, study.floor_spectra))


def summary(study: Study) -> list[Grid]:
    """Return what a reader wants to know first, as tables: the verdict, and what it rests on."""
    impossible = [[one.title, one.printed] for one in findings(study.cube)]
    return [
        opening_grid(opening(study)),
        verdict_grid(judge(study.cube, study.floor_spectra)),
        agreement_grid(study),
        hertz_grid(study),
        Grid("What can't be", [("", "in the paper's tables"), ("", "printed")], impossible),
        largest_grid(study),
        checks_grid(study),
        error_grid(study),
    ]


def agreement_grid(study: Study) -> Grid:
    """Write how near each reading comes to each table, over all records."""
    rows: list[list[str]] = []
    headings: list[tuple[str, str]] = []
    for number in TABLES:
        grid = agreement(number, side_by_side(number, study.cube))
        headings = [("", "table"), *(pair for pair in grid.headings if pair[1] != "record")]
        rows += [[str(number), *row[:2], *row[3:]] for row in grid.rows if row[2] == ALL]
    return Grid("Agreement with Tables 3 to 6, over all records", headings, rows)


def verdict_grid(judgements: Sequence[Judgement]) -> Grid:
    """Write the verdicts: one row per conclusion and reading, and one per claim."""
    rows = []
    for judgement in judgements:
        label = READINGS[judgement.reading].label
        rows.append([judgement.conclusion.key, label, judgement.verdict.value, "", judgement.conclusion.text])
        for claim, outcome in zip(judgement.conclusion.claims, judgement.outcomes, strict=True):
            cases = f"{outcome.held}/{outcome.cases}"
            rows.append(["", "", outcome.verdict.value, cases, f"{claim.text} {outcome.numbers}"])
    headings = ("", "reading", "verdict", "cases", "conclusion, and its claims with the numbers")
    return Grid("The paper's conclusions", [("", text) for text in headings], rows)


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
        own = f"{record.pga / STANDARD_GRAVITY:.3f}", f"{duration:g}", f"{record.duration:.2f}"
        rows.append([record_title(key), f"{pga:g}", *own, note])
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
    found = largest_steps(study.steps)
    readings = [READINGS[str(key)] for key in found["reading"].values]
    rows = []
    for scheme in found["scheme"].values:
        for located in found["located"].values[::-1]:
            values = [float(found.sel(reading=r.key, scheme=scheme, located=located)) * 1e3 for r in readings]
            texts = [f"{value:g} ms" if np.isfinite(value) else "none" for value in values]
            rows.append([str(scheme), "yes" if located else "no", *texts])
    headings = [("", text) for text in ("scheme", "contacts located", *(r.label for r in readings))]
    return Grid(f"Largest step with errors within {LIMIT:.0%} and the right number of impacts", headings, rows)


def checks_grid(study: Study) -> Grid:
    """Write the energy checks."""
    headings = [("", text) for text in ("what must be", "reading", "largest departure", "of", "relative")]
    rows = [
        [
            one.text,
            READINGS[one.reading].label,
            f"{one.value:.2g} {one.unit}",
            f"{one.scale:.0f} {one.unit}",
            f"{one.relative:.1e}",
        ]
        for one in energy_checks(study.cube)
    ]
    return Grid("Energy", headings, rows)


def hertz_grid(study: Study) -> Grid:
    """Write how the forces of Models IV to VI compare with Table 5 under both Hertz stiffnesses."""
    headings = [("", "model"), ("", "floors in Table 5")]
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


def header_groups(grid: Grid) -> list[tuple[str, int]]:
    """Return the groups of a table's headings with their widths; none where no heading has one."""
    groups = [(group, len(list(columns))) for group, columns in groupby(grid.headings, key=lambda pair: pair[0])]
    return groups if any(group for group, _ in groups) else []


def _how(cube: xr.Dataset) -> str:
    """Say how the cubes were integrated, as far as they agree."""
    attributes = cube.attrs
    if "method" not in attributes or "time_step" not in attributes:
        return "the cubes differ in scheme or step"
    located = "" if attributes.get("located") else "not "
    step = 1e3 * float(np.max(attributes["time_step"]))
    return f"{attributes['method']} with steps of at most {step:g} ms, contacts {located}located inside their steps"


def _headed(table: tuple[list[str], list[list[str]]]) -> tuple[list[tuple[str, str]], list[list[str]]]:
    return [("", text) for text in table[0]], table[1]


def _embedded(picture: Picture) -> dict[str, Any]:
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    return {"number": picture.number, "title": picture.title, "source": f"data:image/png;base64,{data}"}
