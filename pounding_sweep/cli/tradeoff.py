"""``tradeoff``: what accuracy costs, measured on a sample of a sweep's own scenarios."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from pounding_sweep.base.text import finite, print_json, print_table
from pounding_sweep.cli.app import FIGURE_FILE, AsJson, Folders, Quiet, SweepFile, Workers, command, numbers_of
from pounding_sweep.cli.reporting import reporting

if TYPE_CHECKING:
    import xarray as xr


@command("tradeoff")
def tradeoff_command(
    sweep: SweepFile,
    out: Annotated[
        Path | None, Option("-o", "--output", metavar="TRADE.nc", help="netCDF file for the result.")
    ] = None,
    steps: Annotated[
        str | None, Option(metavar="LIST", help="Time steps (s), separated by commas; 5e-3 to 2.5e-4 by default.")
    ] = None,
    scenarios: Annotated[int, Option(metavar="N", help="About how many scenarios to measure on.")] = 96,
    seed: Annotated[int, Option(metavar="S", help="Seed of the random sample.")] = 0,
    figure: Annotated[
        Path | None, Option("--plot", metavar="FILE", help=f"Work-precision figure: {FIGURE_FILE}")
    ] = None,
    folders: Folders = None,
    workers: Workers = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace TRADE.nc if it exists.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure error and cost of schemes, steps and number formats on a sample of a sweep."""
    with reporting():
        from pounding_sweep.accuracy.tradeoff import DEFAULT_STEPS, tradeoff
        from pounding_sweep.cli.progress import make_progress
        from pounding_sweep.figures import plot
        from pounding_sweep.output.netcdf import check_output, write_cube
        from pounding_sweep.run.sweep import load_sweep

        if out is not None:
            check_output(out, overwrite)
        if figure is not None:
            check_output(figure, overwrite=True, netcdf=False)
        loaded = load_sweep(sweep, folders=folders or None)
        form = "steps (s); give numbers with commas between, as 2e-3,1e-3"
        chosen = DEFAULT_STEPS if steps is None else numbers_of(steps, "--steps", form)
        with closing(make_progress(quiet)) as progress:
            trade = tradeoff(loaded, steps=chosen, scenarios=scenarios, seed=seed, workers=workers, progress=progress)
        if out is not None:
            write_cube(trade, out, overwrite)
        if as_json:
            print_json(_report(trade))
        else:
            _print_trade(trade)
        files = [] if figure is None else [plot(trade, "work-precision", figure)]
        files += [] if out is None else [out]
        if files and not as_json:
            print(*files, sep="\n")


def _report(trade: xr.Dataset) -> dict[str, Any]:
    """Collect everything that is printed, and every output."""
    from pounding_sweep.accuracy.trade_report import trade_rows

    counts = ("sample_scenarios", "sensitive_scenarios", "touching_scenarios", "unique_scenarios")
    errors: dict[str, Any] = {}
    frame = trade["reference_error"].transpose("output", "population", "statistic").to_series()
    for (output, population, statistic), error in frame.items():
        errors.setdefault(output, {}).setdefault(population, {})[statistic] = finite(error)
    return {
        **{name: int(trade.attrs[name]) for name in counts},
        "reference_step": float(trade.attrs["reference_step"]),
        "reference_errors": errors,
        "configurations": trade_rows(trade),
    }


def _print_trade(trade: xr.Dataset) -> None:
    from pounding_sweep.accuracy.trade_report import leading_outputs, order_table, table_of

    attributes = trade.attrs
    sample, sensitive = int(attributes["sample_scenarios"]), int(attributes["sensitive_scenarios"])
    headings, rows = table_of(trade)
    right = tuple(range(3, len(headings) - 1))
    print_table(headings, rows, right=right)
    print()
    print(
        f"{sample} of {attributes['touching_scenarios']} touching scenarios are measured. Errors are relative, of the "
        f"{sample - sensitive} that are not sensitive."
    )
    print(
        "s per 1000: processor seconds per thousand scenarios on one core; * no other row is cheaper and as accurate."
    )
    own = trade["reference_error"].sel(population="steady", statistic="worst")
    limits = ", ".join(f"{own.sel(output=name).item():.1e} ({name})" for name in leading_outputs(trade))
    print(
        f"Compared with {attributes['reference']} at {attributes['reference_step']:.4g} s, whose worst error is at "
        f"most {limits}; < marks errors below {attributes['resolution_factor']:g} times that of the same scenarios."
    )
    print()
    headings, rows = order_table(trade)
    print_table(headings, rows, right=tuple(range(2, len(headings))))
    print("order: by which power of the step the median error falls (located, float64; resolved errors only).")
    if sensitive:
        print()
        print(
            f"{sensitive} scenarios ({sensitive / sample:.1%}) are sensitive: gaps, stiffness and ground motion "
            f"changed by {attributes['input_change']:g} of themselves change an output by more than "
            f"{attributes['sensitive_change']:g}. Their errors:"
        )
        headings, rows = table_of(trade, "sensitive")
        print_table(headings[:-2], [row[:-2] for row in rows], right=right)
