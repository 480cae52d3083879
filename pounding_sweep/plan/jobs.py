"""One chunk as a worker gets it, whoever that is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan.scenarios import Scenarios


@dataclass(frozen=True)
class Job:
    """One chunk, ready to be run by anybody.

    Attributes
    ----------
    key : str
        Name of the chunk.
    kernel : RowKernel
        What runs.
    record : int
        Index of the record.
    table : Scenarios
        Scenarios to run.
    variants : Variants
        Their building properties.
    outputs : tuple of str
        Variables asked for.
    """

    key: str
    kernel: RowKernel
    record: int
    table: Scenarios
    variants: Variants
    outputs: tuple[str, ...]


#: (kernel, record, scenarios, variants, outputs) -> table of results, or what went wrong; can be pickled
Run = Callable[..., "np.ndarray | str"]
#: (position of the chunk, its table or what went wrong)
Take = Callable[[int, "np.ndarray | str"], None]
