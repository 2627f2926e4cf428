"""A scenario that several tests of the command line plan: a room with walls, each with a gap at one end."""

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
