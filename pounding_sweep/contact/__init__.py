"""Contact laws: what two floors do to each other while they touch."""

from pounding_sweep.contact.hertz import hertz_stiffness
from pounding_sweep.contact.laws import LAWS, MATE2015_MODELS, RESTING_SPEED, Law, get_law

__all__ = ["LAWS", "MATE2015_MODELS", "RESTING_SPEED", "Law", "get_law", "hertz_stiffness"]
