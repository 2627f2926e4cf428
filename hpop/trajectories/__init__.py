"""Trajectories: timed motions from start to goal, alone, in batches and as tables."""
