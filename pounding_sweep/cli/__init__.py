"""The command line: parse, call, print.

Data go to stdout; progress, warnings and errors to stderr. Exit codes: 0, 1 failed, 2 wrong usage or bad input, 130
interrupted. Each module holds the commands of one subject and registers them when it is imported, in the order in which
``--help`` lists them.
"""

from pounding_sweep.cli import sweeps, cubes, compare, accuracy, paper, records  # noqa: F401, I001  in this order
from pounding_sweep.cli.app import main

__all__ = ["main"]
