"""Parts of a cube by value: never another scenario than the one that was asked for."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.app import axis_values
from pounding_sweep.output.select import NEAR, select


def line(axis, values):
    """A dataset whose x tells the place on its axis."""
    return xr.Dataset({"x": (axis, np.arange(len(values)))}, {axis: values})


@pytest.mark.parametrize("value", [1_400_000, "1400000", 1_400_000.0, "1.4e6", np.int64(1_400_000)])
def test_numbers_of_cases_are_exact(value):
    cases = line("case", np.arange(1, 1_500_001))
    assert int(select(cases, {"case": value}).x) == 1_399_999


@pytest.mark.parametrize("value", [0.5, 1_500_001, "9" * 5000, 10**400, "nan", "x"])
def test_what_is_no_case_is_refused_in_few_words(value):
    with pytest.raises(InputError, match=r"it has 1500000 values from 1 to 1500000|it has 1500000 values") as caught:
        select(line("case", np.arange(1, 1_500_001)), {"case": value})
    assert len(str(caught.value)) < 500


def test_neighbours_are_named():
    with pytest.raises(InputError, match=r"from 0\.0 to 0\.99; next to that: 0\.1 and 0\.11"):
        select(line("gap", np.arange(100) / 100), {"gap": "0.105"})
    with pytest.raises(InputError, match=r"next to that: 0\.99$"):
        select(line("gap", np.arange(100) / 100), {"gap": "2"})


def test_values_that_are_nearly_equal_are_told_apart():
    gaps = line("gap", [0.01, 0.01 * (1 + 3e-7), 0.02])
    for place, gap in enumerate(gaps.gap.values.tolist()):
        assert int(select(gaps, {"gap": repr(gap)}).x) == place
    with pytest.raises(InputError, match=r"'0\.0100000001' is within 1e-06 of 2 values .*0\.01, .*give all figures"):
        select(gaps, {"gap": "0.0100000001"})
    assert int(select(gaps, {"gap": "0.020000001"}).x) == 2


@given(
    st.lists(st.floats(1e-6, 1e3), min_size=1, max_size=30, unique=True),
    st.integers(0, 29),
    st.floats(-2 * NEAR, 2 * NEAR),
)
def test_the_right_value_or_none(values, place, off):
    place %= len(values)
    number = values[place] * (1 + off)
    near = [abs(value - number) <= NEAR * number for value in values]
    dataset = line("gap", values)
    if number in values:
        assert values[int(select(dataset, {"gap": number}).x)] == number
    elif sum(near) == 1:
        assert near[int(select(dataset, {"gap": number}).x)]
    else:
        with pytest.raises(InputError, match=r"not on the axis|give all figures"):
            select(dataset, {"gap": number})


def test_several_values_keep_the_axis():
    dataset = line("gap", [0.01, 0.02, 0.03]).expand_dims(law=["linear", "hertz"])
    part = select(dataset, axis_values(["gap=0.03", "law = hertz", "gap=0.01"]))
    assert part.gap.values.tolist() == [0.01, 0.03]
    assert part.x.values.tolist() == [0, 2]
    assert part.law.item() == "hertz"
    assert select(dataset, axis_values(["gap=0.03", "gap=0.030"])).x.dims == ("law",)
    assert select(dataset, {"law": ["hertz", "linear"]}).law.values.tolist() == ["linear", "hertz"]
    with pytest.raises(InputError, match="no value of gap is given"):
        select(dataset, {"gap": []})


def test_an_audit_has_no_scenarios_to_select():
    dataset = line("gap", [0.01, 0.02]).assign(audit_error=(("audit", "output"), np.zeros((2, 1))))
    dataset = dataset.assign_coords(output=["drift_max"], audit=[1, 2])
    with pytest.raises(InputError, match=r"unknown axis 'output'; valid: gap$"):
        select(dataset, {"output": "drift_max"})
    with pytest.raises(InputError, match=r"unknown axis 'gab'; did you mean 'gap'\? Valid: gap$"):
        select(dataset, {"gab": 1})
    assert select(line("output", ["drift_max", "impulse"]), {"output": "impulse"}).x == 1  # such as of a trade-off


def test_many_labels_are_listed_in_part():
    with pytest.raises(InputError, match=r"unknown record 'no'; valid: .*, and 9950 more$") as caught:
        select(line("record", [f"station-{n}" for n in range(10_000)]), {"record": "no"})
    assert len(str(caught.value)) < 2000


def test_cases_are_chosen_by_what_they_list():
    """All that have one of the values, as they stand; what is along other axes is none of that."""
    listed = {"law": ("case", ["none", "hertz", "none"]), "gap": ("case", [0.01, 0.02, 0.03]), "case": [1, 2, 5]}
    cases = xr.Dataset({"x": ("case", [0, 1, 2])}, {**listed, "height": ("storey", [3.0])})
    assert select(cases, {"law": "none"}).x.values.tolist() == [0, 2]
    assert select(cases, {"law": "none"})["case"].values.tolist() == [1, 5]
    assert select(cases, {"law": "none", "gap": 0.03}).x.values.tolist() == [2]
    assert select(cases, {"gap": ["0.02", 0.03 * (1.0 + 0.5 * NEAR)]}).x.values.tolist() == [1, 2]
    with pytest.raises(InputError, match="unknown law 'linear'; valid: hertz, none"):
        select(cases, {"law": "linear"})
    with pytest.raises(InputError, match="unknown axis 'height'; valid: case, gap, law, storey"):
        select(cases, {"height": 3.0})
