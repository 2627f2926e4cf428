"""Exact search where costs depend on when an arc is taken: :mod:`.timed_paths`."""
