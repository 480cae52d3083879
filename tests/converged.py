"""Compute the converged values that `pounding-sweep doctor` checks an installation against.

``python tests/converged.py`` writes ``pounding_sweep/data/converged.json`` anew, from `reference` at two
tolerances: the tighter run gives the values, the difference between the two is stored as their error.
"""

from __future__ import annotations

import json
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np
import reference

import pounding_sweep as ps

FILE = Path(ps.__file__).parent / "data" / "converged.json"
PRESET, RECORD = "mate2015", "el_centro"
LAWS, GAPS = ("linear", "kelvin_voigt", "hertz_damped", "none"), (0.008, 0.016)  # m
#: Outputs that are compared: by building, and by pair.
OUTPUTS = ("displacement_max", "displacement_min", "drift_max", "storey_shear_max")
CONTACT_OUTPUTS = ("impact_force_max", "impact_count", "penetration_max", "first_impact_time")
TOLERANCES = ((1e-11, 1e-13), (1e-9, 1e-11))  # relative and absolute, the tighter first


def values(law: str, gap: float, rtol: float, atol: float) -> dict[str, list[list[float | None]]]:
    """Run one scenario; lists by building or pair, then by storey."""
    scene, record = ps.get_preset(PRESET), ps.find_record(RECORD)
    row = [
        reference.ShearBuilding(
            list(b.masses), list(b.stiffnesses), b.damping_ratio, storey_heights=list(b.storey_heights)
        )
        for b in scene.buildings
    ]
    k = scene.contact.hertz_stiffness if law == "hertz_damped" else scene.contact.linear_stiffness
    motion = record.acceleration, record.dt
    run = reference.run(row, [gap, gap], *motion, law, k, scene.contact.restitution, rtol=rtol, atol=atol)
    names = OUTPUTS if law == "none" else (*OUTPUTS, *CONTACT_OUTPUTS)
    return {
        name: [[None if v is None or np.isnan(v) else float(v) for v in part] for part in run[name]] for name in names
    }


def difference(one: dict[str, list[list[float | None]]], other: dict[str, list[list[float | None]]]) -> float:
    """Return the largest difference, relative to the largest value of each output."""
    off = []
    for name in one:
        a, b = (np.array([v for part in run[name] for v in part], dtype=float) for run in (one, other))
        off.append(float(np.nanmax(np.abs(a - b), initial=0.0) / (np.nanmax(np.abs(a)) or 1.0)))
    return max(off)


def main() -> None:
    scenarios = []
    for law in LAWS:
        for gap in GAPS if law != "none" else GAPS[:1]:
            tight, loose = (values(law, gap, *tolerance) for tolerance in TOLERANCES)
            scenarios.append({"law": law, "gap": gap, "error": difference(tight, loose), "values": tight})
            print(f"{law} {gap} m: tolerances differ by {scenarios[-1]['error']:.1e}", flush=True)
    (rtol, atol), (rtol_2, atol_2) = TOLERANCES
    made = {
        "made_by": "tests/converged.py, from tests/reference.py: DOP853 restarted at every record point and contact",
        "tolerances": f"rtol {rtol:g}, atol {atol:g}; error: largest relative difference to rtol {rtol_2:g}, "
        f"atol {atol_2:g}",
        **{name: version(name) for name in ("scipy", "numpy")},
        **{"python": platform.python_version(), "preset": PRESET, "record": RECORD},
        "record_sha256": ps.find_record(RECORD).sha256,
        "scenarios": scenarios,
    }
    FILE.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
