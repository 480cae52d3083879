"""The self-check of an installation: it passes here, notices a wrong value, and stores values of the reference."""

from __future__ import annotations

import copy
import json
import re
from importlib.metadata import PackageNotFoundError

import converged as source
import numpy as np
import pytest
from scenes import call

from pounding_sweep.accuracy import self_check
from pounding_sweep.run import diagnosis as doctor


@pytest.fixture(scope="module")
def found():
    return self_check.self_check()


@pytest.mark.slow
def test_this_installation_passes(found):
    assert found["passed"]
    assert found["scenarios"] == len(self_check.converged()["scenarios"])
    assert found["values"] == sum(
        len(part) for item in self_check.converged()["scenarios"] for parts in item["values"].values() for part in parts
    )
    assert 0.0 < found["error_max"] <= self_check.TOLERANCE
    assert found["error_stored"] < 1e-3 * self_check.TOLERANCE


def tampered(change):
    stored = copy.deepcopy(self_check.converged())
    change(stored)
    return lambda: stored


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            lambda s: s["scenarios"][0]["values"]["impact_force_max"][0].__setitem__(2, 1e4),
            "impact_force_max of law 'linear' at a gap of 0.008 m is off by",
        ),
        (lambda s: s.__setitem__("record_sha256", "0" * 64), "record 'el_centro' is not the one of the stored values"),
    ],
)
def test_a_wrong_value_is_noticed(change, fault, monkeypatch):
    monkeypatch.setattr(self_check, "converged", tampered(change))
    done = call("doctor", "--json", code=1)
    assert "does not compute the stored values" in done.stderr
    (said,) = json.loads(done.stdout)["self_check"]["faults"]
    assert fault in said


@pytest.mark.slow
def test_it_is_printed(monkeypatch):
    said = call("doctor").stdout
    for part in ("Threads", "workers", "Memory", "free", "Self check", "error_max", "passed"):
        assert part in said
    wrong = tampered(lambda s: s["scenarios"][0]["values"]["first_impact_time"][0].__setitem__(2, None))
    monkeypatch.setattr(self_check, "converged", wrong)
    said = call("doctor", code=1).stdout
    assert re.search(r"^  passed +no$", said, re.MULTILINE)
    assert "is off by inf" in re.sub(r"\s+", " ", said)
    assert "Self check" not in call("doctor", "--no-check").stdout


def test_it_tells_how_long_compiling_takes():
    """Of a kernel, by what is asked for."""
    found = json.loads(call("doctor", "--no-check", "--json").stdout)["compile_seconds"]
    assert 0.0 < found["default"] < found["all"]
    said = call("doctor", "--no-check").stdout
    assert re.search(r"^Compile seconds\n  default  .* s\n  all      .* s$", said, re.MULTILINE)


NEEDED = [
    "netCDF4>=1.7",
    "numba>=0.61",
    "not-there.at_all>=2; python_version > '3'",
    "pyarrow>=17; extra == 'export'",
    "also-missing>=3; python_version > '3' and extra == 'records'",
    "numba; extra == 'export'",
    "pytest>=8; extra == 'test'",
]


def test_versions_are_of_what_the_package_requires_or_can_use(monkeypatch):
    monkeypatch.setattr(doctor, "requires", lambda name: NEEDED)
    there = {"netCDF4": "1.7", "numba": "0.6", "llvmlite": "0.4", "numpy": "2", "pounding-sweep": "0.1", "pyarrow": "9"}

    def version(name):
        if name in there:
            return there[name]
        raise PackageNotFoundError(name)

    monkeypatch.setattr(doctor, "version", version)
    monkeypatch.setattr(doctor, "installed_versions", doctor.installed_versions.__wrapped__)  # nothing is remembered
    needed = ["python", "pounding-sweep", "llvmlite", "netCDF4", "not-there.at_all", "numba", "numpy"]
    found = doctor.diagnose()
    assert list(found["versions"]) == [*needed, "also-missing", "pyarrow"]
    assert found["optional"] == {"also-missing": "records", "pyarrow": "export"}
    missing = [text for text in found["problems"] if "is not installed" in text]
    assert missing == ["not-there.at_all is not installed; install the package: pip install ."]
    said = call("doctor", "--no-check").stdout
    assert re.search(r"^  also-missing +none$", said, re.MULTILINE)
    assert re.search(r"^  also-missing +records$", said, re.MULTILINE)
    assert re.search(r"^  not-there\.at_all +none$", said, re.MULTILINE)


@pytest.mark.slow
def test_the_stored_values_are_those_of_the_twin():
    """Computed again by other code than the package's, at another tolerance than the stored ones."""
    stored = self_check.converged()
    item = next(item for item in stored["scenarios"] if item["law"] == "kelvin_voigt")
    again = source.values(item["law"], item["gap"], 1e-8, 1e-10)
    assert source.difference(item["values"], again) < 1e-6
    assert item["values"].keys() == again.keys()
    assert np.isfinite(item["error"])
