"""Simulation of drives: a law that tracks a plan, a base with delay, slip and localisation noise, and people."""

from __future__ import annotations

from hpop.simulation.tracking import Command, DriveLimits, Tracker

__all__ = ["Command", "DriveLimits", "Tracker"]
