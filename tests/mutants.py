"""Sixteen small faults put into a copy of the package, one at a time: the default tests catch each of them.

``python tests/mutants.py`` runs, for each, only the tests that are to catch it; with the name of a file of the package,
only the faults in that file.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TESTS = Path(__file__).parent
#: File, its text, the fault, and the tests of the default run that catch it.
MUTANTS = (
    # the damping of a law, a nearby number
    ("data/laws.toml", "0.75*(1 - e*e)", "0.7*(1 - e*e)", "test_laws.py"),
    # sub-steps of a stiff contact ten times as long
    ("kernel/spec.py", "CONTACT_CAP = 0.25", "CONTACT_CAP = 2.5", "test_kernels.py"),
    # touches that are over before the step's end are not looked for
    ("kernel/march.py", "maximum(d1, minimum(fma(h, w0, d0), fma(-h, w1, d1)))", "d1", "test_kernels.py"),
    # the weights of Newmark's average acceleration, the wrong way round
    ("schemes/newmark.py", "h * (1.0 - gamma)", "h * gamma * 0.99", "test_analytic.py"),
    # idle lanes hold the first scenario, not the last
    ("engine/row_kernel.py", 'LANES - n)), "edge"', 'LANES - n)), "wrap"', "test_properties.py"),
    # a motion answers for scenarios whose gap it closes by a hair
    ("plan/plan.py", "(most * (1.0 + CLOSING_MARGIN))", "(most * 0.99)", "test_plan.py"),
    # an error of ten times what was asked passes
    (
        "run/refinement.py",
        "allowed = accuracy / np.maximum(",
        "allowed = 10.0 * accuracy / np.maximum(",
        "test_refinement.py",
    ),
    # scenarios beyond the stability limit are run
    ("plan/plan.py", "/ choice.steps > limit", "/ choice.steps > 2.0 * limit", "test_plan.py"),
    # a damaged chunk is read
    ("resume.py", "if checksum != written:", "if False:", "test_limits.py"),
    # shears are of the neighbour's stiffness
    (
        "variables/registry.py",
        'results.slots["drift"] * results.variants.elastic_stiffnesses',
        'results.slots["drift"] * results.variants.elastic_stiffnesses[:, ::-1]',
        "test_kernels.py",
    ),
    # storeys that yield bear a little less than their strength
    (
        "model/storeys/bilinear.py",
        "yielding = spring.phase * (soft * spring.yield_drift)",
        "yielding = spring.phase * (soft * 0.99 * spring.yield_drift)",
        "test_kinds_of_rows.py::test_every_variable_equals_the_reference",
    ),
    # the plastic drift of Bouc and Wen flows while it unloads as while it loads
    (
        "model/storeys/bouc_wen.py",
        "where(z * v < 0.0, -beta, beta)",
        "beta",
        "test_kinds_of_rows.py::test_every_variable_equals_the_reference[smooth-linear-rk4]",
    ),
    # dampers beside contacts that are stepped by series pull a little less
    ("kernel/series.py", "contact.c_active * w)", "0.99 * contact.c_active * w)", "test_flight.py"),
    # the ground pushes a little less inside the steps of flight
    ("kernel/flight.py", "fma(-pushed, ground, total)", "fma(-0.99 * pushed, ground, total)", "test_flight.py"),
    # peaks in flight by rates of the wrong sign
    ("kernel/peaks.py", "21.0 * b7) - 4.0 * r1", "21.0 * b7) + 4.0 * r1", "test_flight.py"),
    # floors at rest on each other take the velocity of the lighter ones
    (
        "kernel/impulse.py",
        "mean = (total[j] + m * x[right]) / (mass[j] + m)",
        "mean = x[right]",
        "test_restitution.py",
    ),
)


def caught_by(name: str, text: str, fault: str, tests: str) -> str:
    """Return the first test that fails with a fault; "" where none does."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "pounding_sweep"
        shutil.copytree(TESTS.parent / "pounding_sweep", package, ignore=shutil.ignore_patterns("__pycache__"))
        path = package / name
        content = path.read_text(encoding="utf-8")
        if text not in content:
            raise SystemExit(f"{name} has no {text!r} any more")
        path.write_text(content.replace(text, fault), encoding="utf-8")
        known = [folder, *filter(None, [os.environ.get("PYTHONPATH")])]
        settings = ["-c", TESTS.parent / "pyproject.toml", "--rootdir", TESTS.parent, "-p", "no:cacheprovider"]
        settings += ["-o", f"pythonpath={folder} {TESTS} {TESTS.parent}"]  # the copy before the package itself
        run = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "--tb=no", *settings, TESTS / tests]
        done = subprocess.run(
            run,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(known)},
            cwd=folder,  # not where the package is: that would come first
            capture_output=True,
            text=True,
            check=False,
        )
        failed = [line.split()[1] for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        if failed and done.returncode == 1:
            return failed[0].partition("tests/")[2]
        return "" if done.returncode == 0 else f"an error: {done.stdout[-500:]}{done.stderr[-500:]}"


def main() -> None:
    """Print what catches each fault; fail where one is not caught."""
    missed = 0
    for name, text, fault, tests in MUTANTS:
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        found = caught_by(name, text, fault, tests)
        missed += "::" not in found
        print(f"{name}: {text} -> {fault}: {found or 'NOT CAUGHT'}", flush=True)
    sys.exit(f"{missed} not caught" if missed else 0)


if __name__ == "__main__":
    main()
