"""A row whose storeys yield costs a small multiple of the elastic one."""

from __future__ import annotations

import pounding_sweep as ps
from benchmarks.timing import medians
from benchmarks.yielding import runner, weakened

#: Most that it may cost, in the same scheme at the same step.
MOST = 4.0


def test_yielding_costs_less_than_four_times_the_elastic_row(benchmark, measured):
    whole = ps.find_record("el_centro")
    record = ps.Record("cut", whole.dt, whole.acceleration[:600])
    scene = ps.get_preset("mate2015")
    jobs = [runner(row, record, "rk4", 2e-3, "kelvin_voigt") for row in (scene, weakened(scene, record))]
    for job in jobs:
        job()

    def ratio() -> float:
        elastic, yields = medians(*jobs, rounds=5)
        return yields / elastic

    found = measured(ratio, lambda value: value <= MOST)
    benchmark.extra_info["yielding_over_elastic"] = found
    assert found[-1] <= MOST
