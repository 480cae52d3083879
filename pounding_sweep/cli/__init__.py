"""The command line: data to stdout, messages to stderr; modules register commands in the order of ``--help``."""

from pounding_sweep.cli import sweeps, cubes, compare, accuracy, paper, records  # noqa: F401, I001  in this order
from pounding_sweep.cli.app import main

__all__ = ["main"]
