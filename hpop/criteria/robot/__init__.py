"""Criteria of the robot, and the joint speeds that several of them read."""

from __future__ import annotations

from hpop.base.arrays import Column
from hpop.motions import Instants, Motions


def joint_rates(m: Motions, s: Instants) -> list[Column]:
    """Return the speed of each joint, rad/s or m/s."""
    return [getattr(s.rates, name) for name in m.model.joints]
