"""The only kernels that the default run compiles, and what of scheme, law, step, precision and outputs they cover.

Compiling one takes a second or two; all else is compiled by tests that are marked slow. `conftest` has these ready
before the tests begin, and fails a test that asks for another.
"""

from __future__ import annotations

import atexit
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from scenes import AXES, EVERY, OUTPUTS, motions, pair, row, yielding_pair

import pounding_sweep as ps
from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.laws import LAWS
from pounding_sweep.variables.registry import VARIABLES, reducers_for

#: The page about laws of one's own: its example runs.
OWN_LAW = Path(__file__).parents[1] / "docs" / "own_law.md"
#: Laws under which `simulate` runs the pair by default, by scheme. Kinds of laws: a damper whose pull is cut (Kelvin
#: and Voigt), forces that rise like a power (Hertz), memory (hysteretic), jumps of velocity (stereomechanical). The
#: other laws differ in their formula, which `test_laws` holds against the reference, and run under each scheme nightly.
SIMULATED = {
    "rk4": frozenset({"kelvin_voigt", "hertz_damped", "hysteretic"}),
    "newmark": frozenset({"hertz_damped", "stereomechanical"}),
    "exact": frozenset({"kelvin_voigt", "stereomechanical"}),
    "central_difference": frozenset({"hertz_damped"}),
}
#: A law with a force for each scheme, out of those.
LAW_OF = {"rk4": "kelvin_voigt", "exact": "kelvin_voigt"}
LAW_OF |= {"newmark": "hertz_damped", "central_difference": "hertz_damped"}
#: Laws that a sweep's scenarios are held against one by one, each in a kernel of its own.
ALONE = ("none", "linear", "hertz")
#: The law and scheme that run with steps that are not split at contacts.
UNLOCATED = ("newmark", "kelvin_voigt")
#: Schemes that run the pair with storeys that yield.
YIELDING = ("rk4", "newmark", "exact")
#: A sweep of that row, its strengths and hardening varied.
YIELDING_SWEEP = {
    "scene": yielding_pair(),
    "records": motions(),
    "laws": ["none", "kelvin_voigt"],
    "gaps": [0.001, 0.004, 0.1],
    "scales": [0.5, 1.0],
    "strength_factors": {"a": [0.5, 1.0, 1e3]},
    "hardenings": {"b": [0.0, 0.2]},
    "dt": 2e-3,
    "outputs": [name for name in OUTPUTS if name != "first_impact_time"] + ["ductility_max", "hysteretic_energy"],
}
#: Two storeys each that lean under their weights, elastic and yielding: there they soften.
LEANING = ps.Scene(
    [
        ps.Building("a", [120.0, 90.0], [6e3, 4.5e3], 0.05, [4.0, 3.0], p_delta=True),
        ps.Building("b", [80.0, 110.0], [9e3, 8e3], 0.03, [4.0, 3.0], p_delta=True),
    ],
    gaps=[0.02],
    contact=ps.ContactProperties(linear_stiffness=8e5, hertz_stiffness=8e6, restitution=0.6),
)
LEANING_YIELDS = ps.Scene(
    [
        replace(LEANING.buildings[0], yield_strengths=[150.0, 90.0], hardening=0.05),
        replace(LEANING.buildings[1], yield_strengths=[180.0, float("inf")], hardening=0.02),
    ],
    LEANING.gaps,
    LEANING.contact,
)
#: The row that leans, with storeys of Bouc and Wen; and the schemes that run it.
SMOOTH = ps.Scene(
    [
        replace(building, yield_strengths=strengths, hardening=hardening, hysteresis=law)
        for building, strengths, hardening, law in (
            (
                LEANING.buildings[0],
                [150.0, 90.0],
                [0.05, 0.3],
                {"law": "bouc_wen", "n": 1.0, "beta": 0.6, "gamma": 0.3},
            ),
            (LEANING.buildings[1], [180.0, 140.0], [0.05, 0.0], {"law": "bouc_wen", "n": 2.0}),
        )
    ],
    [0.005],
    LEANING.contact,
)
SMOOTHING = ("exact", "rk4", "newmark")
#: Storeys of each law that degrades, beyond their caps; one of them leans.
DEGRADING = ps.Scene(
    [
        replace(building, yield_strengths=strengths, hardening=0.05, hysteresis=law)
        for building, strengths, law in (
            (
                LEANING.buildings[0],
                [150.0, 90.0],
                {
                    "law": "pinching",
                    "cap_drift": 0.04,
                    "residual": 0.2,
                    "deterioration": {"strength": 0.8, "unloading": 1.0},
                },
            ),
            (
                replace(LEANING.buildings[1], p_delta=False),
                [150.0, 120.0],
                {"law": "peak_oriented", "cap_drift": [0.03, 0.02], "post_cap": -0.05},
            ),
            (
                ps.Building("c", [80.0, 60.0], [9e3, 6e3], 0.05, [4.0, 3.0], [1.0, 1.0], damping_stiffness="tangent"),
                [120.0, 70.0],
                {"law": "bilinear", "cap_drift": 0.04, "residual": 0.4},
            ),
        )
    ],
    [0.005, 0.01],
    LEANING.contact,
)
#: The pair with a dashpot, its roofs linked; and the schemes that run it.
LINKED = ps.Scene(
    [replace(pair().buildings[0], dashpots=[300.0, 0.0]), pair().buildings[1]],
    [0.003],
    pair().contact,
    links=[ps.Link("a-b", [2], 2e4, 300.0)],
)
LINKING = ("rk4", "newmark", "exact")
#: The pair, the left building on a foundation; and the schemes that run it.
FOUNDED = ps.Scene(
    [replace(pair().buildings[0], foundation=ps.Foundation(70.0, 500.0, 2.5e5, 6e6, 900.0, 8e3)), pair().buildings[1]],
    [0.003],
    pair().contact,
)
FOUNDING = ("rk4", "newmark", "exact")
#: The pair, the left building by the matrix of its storeys; and the schemes that run it, each under a law of the pair.
MATRIX = ps.Scene(
    [
        replace(pair().buildings[0], stiffnesses=None, stiffness_matrix=pair().buildings[0].lateral_matrix),
        pair().buildings[1],
    ],
    pair().gaps,
    pair().contact,
)
MATRICES = {"exact": "kelvin_voigt", "rk4": "kelvin_voigt", "newmark": "hertz_damped"}
#: A law that is damped on rebound only, by bumpers in the gap.
BUMPER = ps.rubber_bumper(0.01, key="bumper", stiffness=3e8)
#: Rubber between the pair and, before one floor of a wall, a law of another kind; what is bare takes the sweep's.
BUMPED = ps.Scene(
    [*pair().buildings, ps.Building("c", [100.0, 70.0], [0.9e5, 0.8e5]), ps.Wall()],
    [0.012, 0.003, 0.006],
    pair().contact,
    bumpers=[
        ps.Bumper("a-b", "rubber_bumper", 3e8, 0.5, 0.009),
        ps.Bumper("c-wall", "modified_kelvin_voigt", 2e5, 0.4, storeys=[1]),
    ],
)
#: Laws of which all are polynomials, so that `exact` steps their contacts by series.
PADDED = replace(BUMPED, bumpers=[ps.Bumper("a-b", "modified_kelvin", 3e5, 0.5, 0.009), BUMPED.bumpers[1]])
#: A row of more floors than one straight line of code holds: its loops are split within and between buildings.
TALL = ps.Scene(
    [ps.Building("tower", [100.0] * 12, [4.5e5] * 12), ps.Building("annex", [120.0] * 5, [3.5e5] * 5)], gaps=[0.01]
)
#: Floors that strike columns, on the ground and above, of either side; a wall that meets one floor of two.
STAGGERED = ps.Scene(
    [
        ps.Building("a", [120.0, 90.0], [1.5e5, 1.2e5]),
        ps.Building("b", [80.0, 110.0], [2.4e5, 2e5], 0.03, [2.0, 3.5], column_stiffnesses=[5e4, 4e4]),
        ps.Wall(),
    ],
    gaps=[0.003, 0.004],
    contact=pair().contact,
    contacts="floors and columns",
    storeys={"b-wall": [1]},
)
#: A floor that strikes a column, and nothing else that meets.
FRAMED = ps.Scene(
    [
        ps.Building("a", [60.0, 90.0], [2e5, 1e5], storey_heights=[3.0, 1.0]),
        ps.Building("b", [80.0, 110.0], [1.4e5, 9e4], 0.0, [3.0, 3.2]),
    ],
    gaps=[0.004],
    contacts="floors and columns",
    storeys={"a-b": [2]},
)


@cache
def simulated(method: str, law: str | ps.Law, *, located: bool = True, scene: ps.Scene | None = None) -> KernelSpec:
    """The kernel that `simulate` compiles for the pair, or for another row."""
    reducers = reducers_for([name for name in VARIABLES if name != "closing_max"])
    return kernel_shape(scene or pair(), ps.get_law(law), Numerics(method, 1e-3, located), reducers, history=True)


def swept(**sweep) -> list[KernelSpec]:
    """The kernels of a sweep: one per law, and one without pounding that tells who can touch."""
    return ps.Sweep(**sweep).plan().shapes()


@cache
def own_law() -> Path:
    """Return the sweep of the page about laws of one's own, written beside its law file."""
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder)
    for name, text in re.findall(r"^```\w+\n# (\w+\.(?:py|toml))\n(.*?)^```", OWN_LAW.read_text("utf-8"), re.M | re.S):
        (folder / name).write_text(text, "utf-8")
    return folder / "own_law.toml"


@cache
def kernels() -> tuple[KernelSpec, ...]:
    """All of them, those that take longest first."""
    both = {"scene": pair(), "records": motions()[0], "gaps": [0.001, 0.002, 0.004, 0.006], "outputs": EVERY}
    single = {"method": "exact", "precision": "float32", "damping_ratios": [0.02, 0.05]}
    method, law = UNLOCATED
    return (
        *(simulated(method, law) for method, laws in SIMULATED.items() for law in sorted(laws)),
        simulated(method, law, located=False),
        *(simulated(method, "hertz_damped", scene=BUMPED) for method in ("rk4", "newmark")),
        simulated("exact", "kelvin_voigt", scene=PADDED),
        simulated("rk4", "kelvin_voigt", scene=TALL),
        *(simulated(method, "kelvin_voigt", scene=yielding_pair()) for method in YIELDING),
        *swept(**YIELDING_SWEEP),
        kernel_shape(yielding_pair(), LAWS["none"], Numerics("rk4", 1e-3), reducers_for(["drift_max"]), varied=True),
        simulated("rk4", "kelvin_voigt", scene=LEANING_YIELDS),
        *(simulated(method, "none", scene=SMOOTH) for method in ("exact", "rk4")),
        *(simulated(method, "linear", scene=SMOOTH) for method in SMOOTHING),
        simulated("exact", "linear", scene=DEGRADING),
        *(
            simulated(method, "linear", scene=ps.Scene([replace(b, p_delta=False) for b in SMOOTH.row], [0.005]))
            for method in ("exact", "rk4")
        ),
        *(simulated(method, "kelvin_voigt", scene=LINKED) for method in LINKING),
        *(simulated(method, "kelvin_voigt", scene=FOUNDED) for method in FOUNDING),
        *(simulated(method, law, scene=MATRIX) for method, law in MATRICES.items()),
        kernel_shape(yielding_pair(), LAWS["kelvin_voigt"], Numerics("exact", 5e-4), reducers_for(EVERY)),
        *(simulated(method, "kelvin_voigt", scene=STAGGERED) for method in ("rk4", "newmark")),
        simulated("rk4", "kelvin_voigt", scene=FRAMED),
        *swept(**both, laws="hertz_damped", method="rk4"),
        *(
            kernel for kernel in swept(**both, laws="hertz_damped", **single) if kernel.law
        ),  # who can touch is not asked first
        *ps.load_sweep(own_law()).plan().shapes(),
        *swept(scene=row(), records=motions(), **AXES | {"laws": [*AXES["laws"], "hertz"]}),
        kernel_shape(pair(), LAWS["kelvin_voigt"], Numerics("exact", 1e-3), reducers_for(EVERY)),
        *(  # which audits of sweeps at a fixed step compare with
            kernel_shape(row(), LAWS[law], Numerics("exact", 1e-3), reducers_for(OUTPUTS), varied=varied)
            for law, varied in (("kelvin_voigt", False), ("linear", False))
        ),
        *(kernel_shape(row(), LAWS[law], Numerics("rk4", 1e-3), reducers_for(OUTPUTS)) for law in ALONE),
    )
