"""Car-like base: model, motion laws, and shortest paths of the Dubins and Reeds-Shepp families."""

from hpop.models.ackermann.laws import CircularArc, Clothoid
from hpop.models.ackermann.model import Ackermann

__all__ = ["Ackermann", "CircularArc", "Clothoid"]
