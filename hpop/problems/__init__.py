"""Planning problems, their solution by planners, and the resulting fronts of trajectories."""
