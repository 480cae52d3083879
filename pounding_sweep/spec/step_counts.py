"""How many steps a scenario may have."""

from __future__ import annotations

from pounding_sweep.records import Record

#: Kernels count steps with 32 bits; so many are far beyond any use.
MAX_STEPS = 2**31 - 1


def step_fault(record: Record, per_interval: float) -> str:
    """Say that a record would take too many steps; "" where it won't.

    Parameters
    ----------
    record : Record
        The ground motion.
    per_interval : float
        Steps per record interval; may be infinite.

    Examples
    --------
    >>> step_fault(Record("pulse", 0.01, [0.0, 1.0, 0.0]), 20), step_fault(Record("pulse", 0.01, [0.0, 1.0]), 1e12)
    ('', "record 'pulse' would take 1e+12 steps; at most 2147483647 are possible")
    """
    steps = per_interval * max(1, record.n_points - 1)
    if steps <= MAX_STEPS:
        return ""
    return f"record {record.name!r} would take {steps:.3g} steps; at most {MAX_STEPS} are possible"
