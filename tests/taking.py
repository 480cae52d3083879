"""What commands make of damaged cubes, one after another; as a program, in a process that may crash or hang."""

from __future__ import annotations

import contextlib
import io
import resource
import sys

from fuzz import HANGING
from stub_engine import install
from typer.main import get_command

from pounding_sweep.cli.app import app
from pounding_sweep.output.netcdf import open_cube

OUT = "out.nc"
#: Made once: it takes as long as a command that is refused.
PROGRAM = get_command(app)
#: What is done with a cube; "CUBE" stands for its path.
COMMANDS = {
    "info": ["info", "CUBE"],
    "merge": ["merge", "CUBE", "b.nc", "-o", OUT, "--overwrite"],
    "extend": ["run", "all.toml", "-o", OUT, "--extend", "CUBE", "--overwrite", "--quiet", "--workers", "1"],
}
#: Attributes of a cube that are the same however it was made.
TOLD = ("sweep", "sweep_sha256", "records", "time_step", "method", "precision", "unit_system")
#: Memory (bytes) in which all that is done; libraries that are loaded take most of it.
MEMORY = 8 * 2**30


def take(command, cube):
    """Take a cube into another by a command; return the exit code and what it said on stderr."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            PROGRAM([word.replace("CUBE", str(cube)) for word in COMMANDS[command]])
            code = 0
        except SystemExit as end:
            code = end.code
    return code, " ".join(said.getvalue().split())


def content(path):
    """Return all values, labels and attributes of variables, and what the cube says of its sweep, to be compared."""
    with open_cube(path) as cube:
        found = {
            str(name): (
                array.dims,
                array.values.tolist() if array.dtype.kind == "U" else array.values.tobytes(),
                str(sorted(array.attrs.items())),  # whose order the netCDF library does not always keep
            )
            for name, array in cube.variables.items()
        }
        return found | {key: str(cube.attrs[key]) for key in TOLD}


def outcome(command, cube):
    """Return what is compared of what a command made: all of a cube, and of one that it described, the results."""
    if command != "info":
        return content(OUT)
    with open_cube(cube) as found:
        return {str(name): array.values.tobytes() for name, array in found.data_vars.items()}


def of_whole(whole):
    """Return what comes of a cube that is not damaged, by command."""
    expected = {}
    for command in COMMANDS:
        done = take(command, whole)
        assert done == (0, ""), done
        expected[command] = outcome(command, whole)
    return expected


def answer(command, path, expected):
    """Take a cube after a command; return its exit code, "same" where nothing came out changed, and what it said."""
    code, words = take(command, path)
    if code == 0:
        code = "same" if outcome(command, path) == expected[command] else "changed"
    return str(code), words


def main(whole):
    """Take every cube that stdin names after a command; tell what came of each."""
    install()
    expected = of_whole(whole)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for command, _, path in (line.partition(" ") for line in sys.stdin.read().splitlines()):
        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        resource.setrlimit(resource.RLIMIT_CPU, (int(used + HANGING), -1))
        print("?", flush=True)
        print(*answer(command, path, expected), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
