"""What users get: the distributions hold what they must, and an installed wheel works away from the sources."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        any(importlib.util.find_spec(name) is None for name in ("build", "hatchling")),
        reason="needs the PyPI packages build and hatchling: pip install build hatchling",
    ),
]

#: Files that are no Python modules and must be there at run time.
DATA = {
    "py.typed",
    "data/NOTICE.md",
    "data/elcentro_ns_1940.csv",
    "data/converged.json",
    *(f"data/mate2015/table{number}.csv" for number in (3, 4, 5, 6)),
    "data/measured.json",
    *(f"pages/{name}.html.j2" for name in ("base", "macros", "report")),
    "paper/report.html.j2",
    *(f"pages/view.{ending}" for ending in ("html.j2", "css", "js")),
}


def run(*command, **more):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=900, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return an sdist and the wheel made from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT)
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


def modules():
    """Return the package's modules as the sources have them."""
    package = ROOT / "pounding_sweep"
    return {path.relative_to(package).as_posix() for path in package.rglob("*.py")}


def test_the_wheel_holds_the_package_and_nothing_else(built):
    with zipfile.ZipFile(built[1]) as wheel:
        names = set(wheel.namelist())
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = wheel.read(about).decode()
        licences = {name.rpartition("/")[2]: wheel.read(name) for name in names if "/licenses/" in name}
    inside = {name.removeprefix("pounding_sweep/") for name in names if name.startswith("pounding_sweep/")}
    assert DATA | modules() <= inside
    assert {f"sweeps/{path.name}" for path in (ROOT / "sweeps").glob("*.toml")} | {"sweeps/bumpers.py"} <= inside
    assert not re.search(r"\]\((?!http)", metadata)  # links to files, of which the wheel has none
    others = {name.partition("/")[0] for name in names} - {"pounding_sweep"}
    assert len(others) == 1
    assert others.pop().endswith(".dist-info")
    assert [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".nbi", ".nbc", ".nc"))] == []
    assert licences["LICENSE"] == (ROOT / "LICENSE").read_bytes()
    assert licences["NOTICE.md"] == (ROOT / "pounding_sweep" / "data" / "NOTICE.md").read_bytes()


def test_the_sdist_holds_what_a_build_and_the_tests_need(built):
    with tarfile.open(built[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    needed = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "tests/reference.py", "sweeps/quickstart.toml"}
    assert needed | {f"pounding_sweep/{name}" for name in DATA | modules()} <= names
    assert [name for name in names if "__pycache__" in name or name.endswith((".pyc", ".nbi", ".nbc"))] == []


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Install the wheel into an environment of its own; what it depends on is found where it is for these tests."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", built[1])
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    # a line in a .pth file adds that folder alone: links to these sources in it are not followed
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin"


def test_an_installed_wheel_works_from_an_empty_folder(installed, tmp_path):
    """A sweep, and the self-check with kernels that are made from the templates in the wheel."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    here, command = {"cwd": tmp_path, "env": environment}, installed / "pounding-sweep"
    place = run(installed / "python", "-c", "import pounding_sweep; print(pounding_sweep.__file__)", **here)
    assert Path(place.strip()).is_relative_to(installed.parent)
    assert "Parametric sweeps of seismic pounding" in run(command, "--help", **here)
    assert run(command, "--version", **here).startswith("pounding-sweep ")
    assert "el_centro" in run(command, "records", **here)
    run(command, "init", **here)
    assert json.loads(run(command, "plan", "quickstart.toml", "--json", **here))["asked"] == 1008
    report = json.loads(run(command, "run", "quickstart.toml", "--json", "--quiet", **here))
    assert report["scenarios"]["asked"] == 1008
    assert sorted(path.name for path in tmp_path.iterdir()) == ["quickstart.nc", "quickstart.nc.log", "quickstart.toml"]
    check = json.loads(run(command, "doctor", "--json", **here))["self_check"]
    assert check["passed"]
    assert check["values"] > 300
