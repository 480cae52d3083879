"""How finely numbers are resolved in both number formats."""

from __future__ import annotations

#: Constants of the kernels that depend on it.
TOLERANCES: dict[str, dict[str, float]] = {
    "float64": {
        "exact": 1e-15,  # relative width of a bracket, and distance (m), below which nothing is gained
        "swept": 1e-13,  # relative change of contact forces at which sweeps over the contacts end
        "unswept": 1e-9,  # and above which they have failed
        "same_time": 1e-12,  # events this close (in steps) are simultaneous
        "just_after": 1e-6,  # fraction of a sub-step after which a force differs from zero by more than rounding
        "at_release": 1e-9,  # and this close to a release, part of it
        "at_kink": 1e-6,  # kinks of a storey no farther (in sub-steps) from an end of a sub-step are at that end
        "done": 1e-13,  # remainder of a step (in steps) that is none
        "far": 1e300,
        "tiny": 1e-300,
        "short": 1e-4,  # sub-steps below this (in steps) are too short for rates from differences
        "moved": 1e-11,  # and those in which floors near each other by less of how far they are, by their rates
        "clear": 1e-14,  # penetration that is none under velocity jumps, beside how far floors are
        "released": 1e-9,  # relative acceleration (m/s2) that does not press there
    },
    "float32": {
        "exact": 1e-7,
        "swept": 1e-6,
        "unswept": 1e-3,
        "same_time": 1e-6,
        "just_after": 1e-3,
        "at_release": 1e-5,
        "at_kink": 1e-3,
        "done": 1e-6,
        "far": 1e38,
        "tiny": 1e-37,
        "short": 3e-2,
        "moved": 2e-3,
        "clear": 5e-7,
        "released": 1e-3,
    },
}
