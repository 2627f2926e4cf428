"""Probabilistic roadmaps: of positions for robots in the plane, of configurations for any robot."""
