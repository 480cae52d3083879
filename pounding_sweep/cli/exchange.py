"""``export`` and ``merge``: cubes in other formats, and cubes of one study put together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import print_pairs
from pounding_sweep.cli.app import At, CubeFile, Folders, Overwrite, axis_values, command
from pounding_sweep.cli.reporting import reporting, say


@command("export")
def export_command(
    cube: CubeFile,
    out: Annotated[
        Path,
        Option("-o", "--output", metavar="FILE", help="What to write: .csv, .parquet or .zarr.", show_default=False),
    ],
    names: Annotated[
        list[str] | None, Option("--var", metavar="NAME", help="Only this variable; repeat for several.")
    ] = None,
    at: At = None,
    table: Annotated[
        bool,
        Option(
            "--table", help="One row per scenario: inputs, measures of its record, all outputs, status, audited errors."
        ),
    ] = False,
    limit_states: Annotated[
        list[str] | None,
        Option(
            "--limit-state",
            metavar="NAME=EVENT[:LEVEL]",
            help="Of a fragility (.xml, OpenQuake NRML): touch=touch, severe=drift:0.03; repeat, the mildest first.",
        ),
    ] = None,
    intensities: Annotated[
        list[str] | None,
        Option(
            "--intensity",
            metavar="MEASURE",
            help="Of a table, a column more, repeat for several; of a fragility, its intensity: pga, pgv, sa(PERIOD), "
            "sa(BUILDING) at its first period, or sa at those of all.",
        ),
    ] = None,
    folders: Folders = None,
    pelicun: Annotated[
        str | None, Option(metavar="BUILDING", help="Demands of this building, as Pelicun (FEMA P-58) reads CSV.")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a cube, or a part of it, as a table (CSV, Parquet) or as Zarr, or for OpenQuake or Pelicun."""
    with reporting():
        from pounding_sweep.analysis.exchange import export_nrml, export_pelicun
        from pounding_sweep.analysis.intensity import with_intensities
        from pounding_sweep.output.export import export_tables
        from pounding_sweep.output.netcdf import open_cube
        from pounding_sweep.output.select import select

        fragility = out.suffix.lower() == ".xml"
        of_fits = {"--limit-state": limit_states, "--intensity": intensities, "--records": folders}
        options = [option for option, value in of_fits.items() if value and (option == "--limit-state" or not table)]
        if options and not fragility:
            also = "" if options[0] == "--limit-state" else " or --table"
            raise InputError(
                f"{options[0]} is for a fragility{also}, and this is none; give -o FILE.xml{also}, or leave it out"
            )
        if fragility and len(intensities or ()) > 1:
            raise InputError(
                f"--intensity is given {len(intensities or ())} times, and a fragility is of one; give one"
            )
        if (fragility or pelicun is not None) and (names or table):
            raise InputError(f"--{'var' if names else 'table'} is for tables of the cube itself; leave it out")
        with open_cube(cube) as dataset:
            part = select(dataset, axis_values(at or []))
            if pelicun is not None:
                samples = export_pelicun(part, out, pelicun, overwrite=overwrite)
                say(f"{samples} samples of building {pelicun}")
                print(out)
            elif fragility:
                states = dict(map(_limit_state, limit_states or ["touch=touch"]))
                measure = next(iter(intensities or ()), None)
                skipped = export_nrml(
                    part, out, states, overwrite=overwrite, intensity=measure, folders=folders or None
                )
                for name, why in skipped.items():
                    say(f"warning: {name} is left out: {why}")
                print(out)
            else:
                part = with_intensities(part, intensities or (), folders=folders or None)
                print(*export_tables(part, out, names or (), overwrite=overwrite, table=table), sep="\n")


def _limit_state(text: str) -> tuple[str, tuple[str, float | None]]:
    """Read NAME=EVENT[:LEVEL]."""
    name, _, rest = text.partition("=")
    event, _, level = rest.partition(":")
    try:
        return name, (event, float(level) if level else None)
    except ValueError:
        raise InputError(
            f"--limit-state {text!r}: {level!r} is no level; give NAME=EVENT or NAME=EVENT:LEVEL, severe=drift:0.03"
        ) from None


@command("merge")
def merge_command(
    cubes: Annotated[list[Path], Argument(metavar="A.nc B.nc ...", help="Cubes of one study.", show_default=False)],
    out: Annotated[
        Path, Option("-o", "--output", metavar="ALL.nc", help="netCDF file for the whole cube.", show_default=False)
    ],
    tolerance: Annotated[
        float | None,
        Option(
            metavar="RATIO",
            help="Difference of two results of a scenario, relative to the variable's largest value in it, that is no "
            "conflict; 1e-6 by default.",
        ),
    ] = None,
    mix_sources: Annotated[
        bool,
        Option(
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

        limit = TOLERANCE if tolerance is None else tolerance
        merged = merge_cubes(cubes, out, overwrite=overwrite, tolerance=limit, mix_sources=mix_sources)
        rows = [
            ("cubes", f"{len(cubes)}"),
            ("scenarios", f"{merged.scenarios}, {merged.overlapping} of them in several cubes"),
        ]
        if merged.missing:
            more = ", ..." if merged.missing > len(merged.named) else ""
            rows.append(("missing", f"{merged.missing} (status not_run): {', '.join(merged.named)}{more}"))
        if merged.sources > 1:
            rows.append(("sources", f"{merged.sources}, by source, numba, llvmlite and numpy (see merged_from)"))
        print_pairs(rows)
        print(merged.path)
