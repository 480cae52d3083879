"""The self-check of an installation: it passes here, notices a wrong value, and its stored values are the twin's."""

from __future__ import annotations

import copy
import json

import converged as source
import numpy as np
import pytest
from typer.testing import CliRunner

from pounding_sweep import self_check
from pounding_sweep.cli.app import app


@pytest.fixture(scope="module")
def found():
    return self_check.self_check()


def test_this_installation_passes(found):
    assert found.passed
    assert found.scenarios == len(self_check.converged()["scenarios"])
    assert found.values == sum(
        len(part) for item in self_check.converged()["scenarios"] for parts in item["values"].values() for part in parts
    )
    assert 0.0 < found.error_max <= self_check.TOLERANCE
    assert found.error_stored < 1e-3 * self_check.TOLERANCE


def tampered(change):
    stored = copy.deepcopy(self_check.converged())
    change(stored)
    return lambda: stored


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            lambda s: s["scenarios"][0]["values"]["impact_force_max"][0].__setitem__(2, 1e4),
            "impact_force_max of law 'linear' at a gap of 0.008 m is off by",
        ),
        (
            lambda s: s["scenarios"][2]["values"]["first_impact_time"][0].__setitem__(2, None),
            "first_impact_time of law 'kelvin_voigt' at a gap of 0.008 m is off by inf",
        ),
        (lambda s: s.__setitem__("record_sha256", "0" * 64), "record 'el_centro' is not the one of the stored values"),
    ],
)
def test_a_wrong_value_is_noticed(change, fault, monkeypatch):
    monkeypatch.setattr(self_check, "converged", tampered(change))
    done = CliRunner().invoke(app, ["doctor", "--json"])
    assert done.exit_code == 1
    assert "does not compute the stored values" in done.stderr
    (said,) = json.loads(done.stdout)["self_check"]["faults"]
    assert fault in said


def test_it_is_printed(monkeypatch):
    done = CliRunner().invoke(app, ["doctor"])
    assert done.exit_code == 0
    for part in ("Threads", "workers", "Memory", "Output", "free", "Self-check", "largest error", "passed"):
        assert part in done.stdout
    wrong = tampered(lambda s: s["scenarios"][0]["values"]["first_impact_time"][0].__setitem__(2, None))
    monkeypatch.setattr(self_check, "converged", wrong)
    said = CliRunner().invoke(app, ["doctor"]).stdout
    assert "infinite" in said
    assert "failed" in said
    assert "Self-check" not in CliRunner().invoke(app, ["doctor", "--no-check"]).stdout


def test_a_folder_that_cannot_be_written_is_a_problem(tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    monkeypatch.setattr("pathlib.Path.cwd", lambda: gone)
    found = json.loads(CliRunner().invoke(app, ["doctor", "--no-check", "--json"]).stdout)
    assert found["output"] == {"folder": str(gone), "writable": False, "free_bytes": None}
    assert any("can't be written; give runs an output path elsewhere" in text for text in found["problems"])


@pytest.mark.slow
def test_the_stored_values_are_those_of_the_twin():
    """Computed again by other code than the package's, at another tolerance than the stored ones."""
    stored = self_check.converged()
    item = next(item for item in stored["scenarios"] if item["law"] == "kelvin_voigt")
    again = source.values(item["law"], item["gap"], 1e-8, 1e-10)
    assert source.difference(item["values"], again) < 1e-6
    assert item["values"].keys() == again.keys()
    assert np.isfinite(item["error"])
