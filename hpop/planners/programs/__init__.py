"""Planners that solve optimisation programs (nonlinear or convex) in continuous space, and modules that they share."""
