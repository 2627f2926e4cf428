"""Simulation of drives: a law that tracks a plan, a base with delay, slip and localisation noise, and people."""

from __future__ import annotations

from hpop.simulation.people import Crowd, Pedestrians, TrackedPeople, Walking
from hpop.simulation.simulate import SimulatedBase, Simulation, farthest_off, simulate
from hpop.simulation.tracking import Command, DriveLimits, Tracker

__all__ = [
    "Command",
    "Crowd",
    "DriveLimits",
    "Pedestrians",
    "SimulatedBase",
    "Simulation",
    "TrackedPeople",
    "Tracker",
    "Walking",
    "farthest_off",
    "simulate",
]
