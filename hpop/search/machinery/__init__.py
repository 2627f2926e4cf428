"""Modules that all searches share: labels, time slices, lower bounds, groups of turns, checkpoints, approximation."""
