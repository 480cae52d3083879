"""How time is stepped: one class per scheme, and the largest step at which it stays bounded."""

from pounding_sweep.schemes.base import Scheme
from pounding_sweep.schemes.exact import Exact
from pounding_sweep.schemes.explicit import CentralDifference, Rk4
from pounding_sweep.schemes.newmark import Newmark

#: Every scheme by its name in sweep files; a new one is a class, and named here.
SCHEMES: dict[str, Scheme] = {scheme.name: scheme for scheme in (Rk4(), Newmark(), Exact(), CentralDifference())}

__all__ = ["SCHEMES", "Scheme"]
