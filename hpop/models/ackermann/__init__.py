"""Car-like base: model, motion laws, and shortest paths by the words of Dubins and of Reeds and Shepp."""

from hpop.models.ackermann.laws import CircularArc, Clothoid
from hpop.models.ackermann.model import Ackermann

__all__ = ["Ackermann", "CircularArc", "Clothoid"]
