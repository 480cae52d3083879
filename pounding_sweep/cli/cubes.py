"""``info`` and ``plot``: what a cube holds, in words and in pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pounding_sweep.cli.app import CubeFile, app
from pounding_sweep.cli.reporting import reporting
from pounding_sweep.figures import FIGURES


@app.command("info")
def info_command(cube: CubeFile) -> None:
    """Describe a cube: axes, variables, statuses, records."""
    with reporting():
        from pounding_sweep.cube.describe import describe
        from pounding_sweep.cube.write import open_cube

        with open_cube(cube) as found:
            print(describe(found))


@app.command("plot")
def plot_command(
    cube: CubeFile,
    kind: Annotated[str, typer.Argument(metavar="FIGURE", help=f"One of: {', '.join(FIGURES)}.", show_default=False)],
    out: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="PNG, SVG or PDF file.", show_default=False)
    ],
) -> None:
    """Draw a figure of a cube into a file."""
    with reporting():
        from pounding_sweep.cube.write import open_cube
        from pounding_sweep.figures import plot

        with open_cube(cube) as found:
            print(plot(found, kind, out))
