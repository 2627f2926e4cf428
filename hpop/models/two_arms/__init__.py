"""Robot model "two_arms": an arm with a camera that watches another arm at its work."""

from hpop.models.two_arms.model import TwoArms

__all__ = ["TwoArms"]
