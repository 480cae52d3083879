"""How time is stepped: one class per scheme, and the largest step at which it stays bounded."""

from pounding_sweep.schemes.base import Scheme
from pounding_sweep.schemes.central_difference import CentralDifference
from pounding_sweep.schemes.exact import Exact
from pounding_sweep.schemes.newmark import Newmark
from pounding_sweep.schemes.rk4 import Rk4

#: Every scheme by its name in sweep files; a new one is its own file, and its class here.
SCHEMES: dict[str, Scheme] = {scheme.name: scheme for scheme in (Rk4(), Newmark(), Exact(), CentralDifference())}

__all__ = ["SCHEMES", "Scheme"]
