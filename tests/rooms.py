"""Scenarios that several tests of the command line plan: a room with walls, and a hall with pillars."""

from __future__ import annotations

from typing import Any

SECOND = "      - {corners: [[4.4, 1.6], [4.8, 1.6], [4.8, 5], [4.4, 5]]}\n"
TWO_WALLS = f"""\
world:
  polygons:
    extent: [[0, 0], [7, 0], [7, 5], [0, 5]]
    obstacles:
      - {{corners: [[2, 0], [2.3, 0], [2.3, 3.2], [2, 3.2]]}}
{SECOND}\
model:
  differential_drive: {{radius: 0.25}}
start: [1, 1, 0]
goal: [6, 4, any]
criteria: [obstruction, turns, length]
planner:
  lattice: {{step: 0.25}}
"""
ONE_WALL = TWO_WALLS.replace(SECOND, "")


def pillars() -> dict[str, Any]:
    """Scenario of a hall of 16 x 12 m with scattered pillars, from corner to corner; without criteria and planner."""
    corners = [(x + 0.37 * (y % 3), y) for x in range(2, 14, 3) for y in range(2, 10, 3)]
    boxes = [{"corners": [[x, y], [x + 0.6, y], [x + 0.6, y + 0.7], [x, y + 0.7]]} for x, y in corners]
    extent = [[0, 0], [16, 0], [16, 12], [0, 12]]
    world = {"polygons": {"extent": extent, "obstacles": boxes}}
    return {"world": world, "start": [1.0, 1.0, 0], "goal": [14.8, 10.6, "any"]}
