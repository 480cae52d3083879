"""``export`` and ``merge``: cubes in other formats, and cubes of one study put together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pounding_sweep.base.tables import print_pairs
from pounding_sweep.cli.app import At, CubeFile, Overwrite, app
from pounding_sweep.cli.cubes import axis_values
from pounding_sweep.cli.reporting import reporting


@app.command("export")
def export_command(
    cube: CubeFile,
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FILE", help="What to write: .csv, .parquet or .zarr.", show_default=False
        ),
    ],
    names: Annotated[
        list[str] | None, typer.Option("--var", metavar="NAME", help="Only this variable; repeat for several.")
    ] = None,
    at: At = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a cube, or a part of it, as a table (CSV, Parquet) or as Zarr."""
    with reporting():
        from pounding_sweep.output.export import export_cube
        from pounding_sweep.output.netcdf import open_cube
        from pounding_sweep.output.select import select

        with open_cube(cube) as found:
            print(export_cube(select(found, axis_values(at or [])), out, names or (), overwrite=overwrite))


@app.command("merge")
def merge_command(
    cubes: Annotated[
        list[Path], typer.Argument(metavar="A.nc B.nc ...", help="Cubes of one study.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="ALL.nc", help="netCDF file for the whole cube.", show_default=False),
    ],
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="RATIO",
            help="Difference of two results of a scenario, relative to the variable's largest value in it, that is no "
            "conflict; 1e-6 by default.",
        ),
    ] = None,
    mix_sources: Annotated[
        bool,
        typer.Option(
            "--mix-sources",
            help="Allow cubes made by several states of one version's source, or with several versions of numba, "
            "llvmlite or numpy; each is named in the cube.",
        ),
    ] = False,
    overwrite: Overwrite = False,
) -> None:
    """Put cubes of one study together: same scene, numerics and outputs, other values on the axes or other cases."""
    with reporting():
        from pounding_sweep.output.merge import TOLERANCE, merge_cubes

        found = merge_cubes(
            cubes,
            out,
            overwrite=overwrite,
            tolerance=TOLERANCE if tolerance is None else tolerance,
            mix_sources=mix_sources,
        )
        rows = [
            ("cubes", f"{len(cubes)}"),
            ("scenarios", f"{found.scenarios}, {found.overlapping} of them in several cubes"),
        ]
        if found.missing:
            more = ", ..." if found.missing > len(found.named) else ""
            rows.append(("missing", f"{found.missing} (status not_run): {', '.join(found.named)}{more}"))
        if found.sources > 1:
            rows.append(("sources", f"{found.sources}, by source, numba, llvmlite and numpy (see merged_from)"))
        print_pairs(rows)
        print(found.path)
