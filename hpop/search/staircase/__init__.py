"""Exact search where one cost is a small integer, with a staircase per node (:mod:`.staircase.search`)."""
