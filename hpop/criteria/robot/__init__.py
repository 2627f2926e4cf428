"""Criteria of the robot (time, energy, clearance, joints), and the joint speeds that several of them use."""

from __future__ import annotations

from hpop.base.arrays import Column
from hpop.motions import Instants, Motions


def joint_rates(m: Motions, s: Instants) -> list[Column]:
    """Return the speed of each joint at the moments ``s``, rad/s or m/s, as a list of columns."""
    return [getattr(s.rates, name) for name in m.model.joints]
