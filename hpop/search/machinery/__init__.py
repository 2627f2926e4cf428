"""Machinery of all searches: labels, slices of time, bounds, groups of turns, checkpoints, approximation."""
