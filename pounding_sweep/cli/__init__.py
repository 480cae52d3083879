"""The command line: parse, call, print.

Data go to stdout; progress, warnings and errors to stderr. Exit codes: 0, 1 failed, 2 wrong usage or bad input, 130
interrupted. Each module holds the commands of one subject and registers them when it is imported, in the order in which
``--help`` lists them.
"""

# isort: off
from pounding_sweep.cli import init
from pounding_sweep.cli import run
from pounding_sweep.cli import cubes
from pounding_sweep.cli import exchange
from pounding_sweep.cli import compare
from pounding_sweep.cli import histories
from pounding_sweep.cli import tradeoff
from pounding_sweep.cli import extremes
from pounding_sweep.cli import paper
from pounding_sweep.cli import lists
from pounding_sweep.cli import records
from pounding_sweep.cli import doctor

# isort: on
from pounding_sweep.cli.app import main

__all__ = [
    "compare",
    "cubes",
    "doctor",
    "exchange",
    "extremes",
    "histories",
    "init",
    "lists",
    "main",
    "paper",
    "records",
    "run",
    "tradeoff",
]
