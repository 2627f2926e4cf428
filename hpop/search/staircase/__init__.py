"""Exact search where one cost is a small integer: a staircase a node (:mod:`.staircase.search`)."""
