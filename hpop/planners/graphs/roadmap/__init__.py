"""Probabilistic roadmaps of positions, and of configurations of any robot."""
