"""How time is stepped: one class per scheme, and the largest step at which it stays bounded."""

import numpy as np

from pounding_sweep.model.scene import Scene
from pounding_sweep.schemes.base import Scheme
from pounding_sweep.schemes.exact import Exact
from pounding_sweep.schemes.explicit import CentralDifference, Rk4
from pounding_sweep.schemes.newmark import Newmark

#: Every scheme by its name in sweep files; a new one is a class, and named here.
SCHEMES: dict[str, Scheme] = {scheme.name: scheme for scheme in (Rk4(), Newmark(), Exact(), CentralDifference())}


def reference_scheme(scene: Scene, gaps: np.ndarray) -> str:
    """Name the scheme of converged solutions: no steps of RK4 are fine enough where floors rest on each other."""
    return "exact" if (gaps <= 0.0).any() and SCHEMES["exact"].refuses(scene) is None else "rk4"


__all__ = ["SCHEMES", "Scheme", "reference_scheme"]
