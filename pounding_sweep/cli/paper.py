"""``paper``: the paper's tables, figures and conclusions beside computed ones, in one report."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path

from pounding_sweep.base.text import print_json, print_table
from pounding_sweep.cli import app
from pounding_sweep.cli.app import AsJson, Folders, Overwrite, Quiet, argument, command, output


@command("paper")
def paper_command(
    out: Path = output("FOLDER", "Folder of the report and its figures.", default=...),
    cubes: list[Path] | None = argument(
        "[CUBE.nc]...", "Cubes of sweeps/mate2015.toml and sweeps/mate2015_as_run.toml; without any, both are run."
    ),
    folders: Folders = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Compute Mate, Bakre & Jaiswal (2015) again and report on its tables, figures and conclusions."""
    from pounding_sweep.output.netcdf import check_output, open_cube
    from pounding_sweep.paper.figures import save_figures
    from pounding_sweep.paper.report import contents_of, summary, write_report
    from pounding_sweep.paper.study import study

    with suppress(OSError):  # said below
        out.mkdir(parents=True, exist_ok=True)
    report = out / "report.html"
    check_output(report, overwrite)
    with ExitStack() as stack:
        opened = [stack.enter_context(open_cube(path)) for path in cubes or ()]
        progress = stack.enter_context(app.progress_display(quiet))
        computed = study(opened, folders=folders, progress=progress)
        for text in computed.missing.values():
            app.say(f"left out: {text}")
        pictures = save_figures(computed, out, progress)
        contents = contents_of(computed)
        write_report(contents, pictures, report)
    if as_json:
        verdicts = [
            {
                "conclusion": judgement.conclusion["key"],
                "reading": judgement.reading,
                "verdict": judgement.verdict,
                "claims": [{"verdict": claim.verdict, **asdict(claim)} for claim in judgement.outcomes],
            }
            for judgement in contents["judgements"]
        ]
        answer = {
            "report": str(report),
            "figures": [str(path) for _, _, path in pictures],
            "records": [record.name for record in computed.records],
            "missing": dict(computed.missing),
            "verdict": [asdict(part) for part in contents["opening"]],
            "verdicts": verdicts,
            "warnings": app.WARNINGS,
        }
        print_json(answer)
        return
    for grid in summary(contents):
        print(f"{grid.title}\n")
        print_table([" ".join(pair).strip() for pair in grid.headings], grid.rows)
        print()
    print(report)
