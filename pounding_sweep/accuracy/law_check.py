"""Whether a contact law does in the kernels what its formulas say: by the certificate, a solver, and a twin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.certificate import APPROACH, MASS, RESTITUTIONS, certify, contact_stiffness
from pounding_sweep.base.errors import LawError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, Law, find_law
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.records import Record
from pounding_sweep.run.execute import Progress
from pounding_sweep.variables.registry import REDUCERS

#: Largest difference between restitutions that agree: kernels and closed forms are exact to far less.
REBOUND_TOLERANCE = 1e-6
#: Differences to the restitution that is asked for: up to the first a law realises it, beyond the second one of a
#: user's own is at fault.
NEAR, FAR = 0.05, 0.25
#: Largest difference between kernel and twin, in parts of the largest value of an output: they round differently.
TWIN_TOLERANCE = 1e-7


@dataclass(frozen=True)
class LawCheck:
    """What a law was held against.

    Attributes
    ----------
    law : Law
        The law.
    certificate : xarray.Dataset
        What `certify` measured of it, with ``solved`` beside it: the restitution by the independent solver.
    twin : dict of str to float
        Largest difference between kernel and twin by what is kept of a scenario, in parts of its largest value.
    impacts : int
        Impacts of the scene that both ran.
    """

    law: Law
    certificate: xr.Dataset
    twin: dict[str, float]
    impacts: int

    @property
    def faults(self) -> list[str]:
        """Where the ways do not agree; empty where the law is what it says."""
        table, worst = self.certificate, max(self.twin, key=self.twin.__getitem__)
        differ = "restitutions that differ by {:.1e}"
        kernel, closed = (
            abs(one - table.solved).max().item() for one in (table.measured, table.analytic.fillna(table.solved))
        )
        checks = [
            (kernel, REBOUND_TOLERANCE, f"kernels and solver give {differ}"),
            (closed, REBOUND_TOLERANCE, f"the closed form {self.law.relation!r} and the solver give {differ}"),
            (self.twin[worst], TWIN_TOLERANCE, f"kernel and twin differ in {worst} by {{:.1e}} of its largest value"),
            (0.0 if self.impacts else 1.0, 0.0, "the scene of the twin had no impact"),
        ]
        faults = [text.format(off) for off, most, text in checks if not off <= most]
        off, text = self.missed
        return faults + [text] * (self.law.key not in LAWS and off > FAR)

    @property
    def missed(self) -> tuple[float, str]:
        """The largest difference to the restitution that is asked for, and a text on it; "" if it is small."""
        table = self.certificate.measured.squeeze("law").dropna("restitution", how="all")
        pairs = [(float(e), float(m)) for e, row in zip(table.restitution, table.T, strict=True) for m in row]
        off, asked, given = max((abs(m - e), e, m) for e, m in pairs if math.isfinite(m))
        text = (
            f"the law does not realise the restitution: its damping number gives {given:.2f} where {asked:g} is asked"
        )
        return off, text if off > NEAR else ""


def check_law(
    law: str | Law, restitutions: Sequence[float] = RESTITUTIONS, *, progress: Progress | None = None
) -> LawCheck:
    """Hold a contact law with a force against an independent solver, its closed form and the kernel's twin.

    Parameters
    ----------
    law : str or Law
        Key of the registry, ``"mylaws.py:my_law"`` or the law.
    restitutions : sequence of float
        Nominal coefficients of restitution.
    progress : Progress, optional
        Display.

    Returns
    -------
    LawCheck
        Its ``faults`` are empty where all agree.

    Raises
    ------
    LawError
        There is no such law, or it has memory or jumps, which the solver does not know.

    Examples
    --------
    >>> mine = Law(key="mine", exponent=1.25, damper="c*d**1.25", damping="elastic", number="1.5*(1 - e)")
    >>> check_law(mine, [0.6]).faults
    []
    """
    checked = find_law(law)
    if checked.exponent is None or checked.yields:
        raise LawError(
            f"law {checked.key!r} has no force that depends on penetration and its rate alone; nothing can be solved"
        )
    certificate = certify(restitutions if checked.takes_restitution else [1.0], [checked], progress=progress)
    solved = xr.apply_ufunc(
        lambda number, basis, e: solved_restitution(checked, e, basis=basis) if np.isfinite(number) else np.nan,
        *(certificate.damping_number, certificate.basis, certificate.restitution),
        vectorize=True,
    )
    solved.attrs = {"units": "1", "long_name": "restitution by an independent solver"}
    certificate = certificate.assign(solved=solved)
    contact = ContactProperties(linear_stiffness=2e5, hertz_stiffness=2e6)
    scene = Scene([Wall(), Building("tower", [30.0], [2e4], damping_ratio=0.05)], gaps=[0.002], contact=contact)
    record = Record("pulse", 0.02, 4.0 * np.sin(2.0 * math.pi * 0.02 * np.arange(60) / 0.4))
    kernel = RowKernel(scene, checked, Numerics("rk4", 4e-3), frozenset(REDUCERS))
    values: dict[str, Any] = {
        "scale": np.ones(1),
        "gaps": np.full((1, 1), 0.002 + checked.thickness),
        "stiffness": np.full(1, contact.reference(checked.exponent) or 2e5 * 100.0 ** (checked.exponent - 1.0)),
        "restitution": np.full(1, 0.6),
    }
    compiled, plain = (kernel.run(record, **values, twin=twin) for twin in (False, True))
    twin = {
        name: float(np.abs(plain[name] - result).max() / max(np.abs(result).max(), 1e-300))
        for name, result in compiled.items()
        if result.size
    }
    return LawCheck(checked, certificate, twin, int(compiled["count"].sum()))


def solved_restitution(
    law: Law,
    e: float,
    *,
    basis: str = "published",
    mass: float = MASS / 2.0,
    stiffness: float | None = None,
    speed: float = APPROACH,
) -> float:
    """Restitution of two free masses by integrating the formulas of a law (DOP853, relative tolerance 1e-12)."""
    # `basis` says what the nominal restitution `e` means; `mass` is the effective one (t), `stiffness` in
    # kN/m**exponent
    from scipy.integrate import solve_ivp

    k, exponent = contact_stiffness(law) if stiffness is None else stiffness, law.exponent or 1.0
    c = float(law.damping_coefficient(e, k, mass, basis)) / (speed if law.damping == "elastic" else 1.0)
    elastic, damper = formulas.read(law.elastic), formulas.read(law.damper) if law.damper else None

    def force(d: float, v: float) -> float:
        variables = {"d": d, "r": math.sqrt(max(d, 0.0)), "k": k, "c": c}
        elastic_force = formulas.value(elastic, variables, formulas.ON_ARRAYS)
        if damper is None or (law.approach_only and v <= 0.0) or (law.rebound_only and v >= 0.0):
            return elastic_force
        return elastic_force + formulas.value(damper, variables, formulas.ON_ARRAYS) * v

    def motion(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -force(y[0], y[1]) / mass]

    def run(start: Sequence[float], ends: Any) -> Any:
        ends.terminal, ends.direction = True, -1.0
        longest = 1e3 * math.pi * (mass / k) ** (1.0 / (exponent + 1.0))
        return solve_ivp(motion, (0.0, longest), start, "DOP853", events=ends, rtol=1e-12, atol=1e-16).y[:, -1]

    deepest = run([0.0, speed], lambda _, y: y[1])[0]

    def parted(_: float, y: np.ndarray) -> float:
        by_depth = law.tension or law.approach_only or law.rebound_only
        return y[0] if by_depth else min(y[0], force(y[0], y[1]))

    return -run([deepest, 0.0], parted)[1] / speed
