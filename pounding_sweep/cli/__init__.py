"""The command line: parse, call, print.

Data go to stdout; progress, warnings and errors to stderr. Exit codes: 0, 1 failed, 2 wrong usage or bad input, 130
interrupted. Each module holds the commands of one subject and registers them when it is imported, in the order in which
``--help`` lists them.
"""

from pounding_sweep.cli import init, run, cubes, exchange, compare, histories  # noqa: F401, I001  in this order
from pounding_sweep.cli import tradeoff, extremes, paper, lists, records, doctor  # noqa: F401  in this order
from pounding_sweep.cli.app import main

__all__ = ["main"]
