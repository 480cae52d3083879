"""The package may not grow above the smallest size that it reached."""

from __future__ import annotations

import json

import pytest

from benchmarks.package_size import LIMITS, SLACK, size


def test_counts(tmp_path):
    (tmp_path / "a.py").write_text('"""Doc."""\n\n\ndef f(x):\n    """Doc."""\n    return x + 1  # a remark\n')
    assert size(tmp_path) == {"lines": 6, "functions": 1, "tokens": 10}


@pytest.mark.parametrize("name", ["lines", "functions", "tokens"])
def test_the_package_does_not_grow(name):
    limit = json.loads(LIMITS.read_text(encoding="utf-8"))[name]
    assert size()[name] <= SLACK * limit, f"remove {name} first, or from elsewhere: the smallest size was {limit}"
