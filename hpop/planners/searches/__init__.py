"""Searches for optimal paths, independent of the kind of graph: each runs on every graph family."""
