"""The joints of a model, as criteria read them; criteria that ask for them require "joints"."""

from __future__ import annotations

from typing import Any

from hpop.base.arrays import Column
from hpop.motions import Instants, Model, Motions


def joints_of(model: Model) -> tuple[str, ...]:
    """Names of the states that are joints."""
    known: Any = model
    return tuple(known.joints)


def joint_rates(m: Motions, s: Instants) -> list[Column]:
    """How fast each joint moves, rad/s or m/s."""
    return [getattr(s.rates, name) for name in joints_of(m.model)]
