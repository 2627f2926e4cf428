"""Criterion, robots, planner and map reader that hpop finds by their entry points."""
