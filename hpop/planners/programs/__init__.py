"""Planners by nonlinear programs, and the parts that they share."""
