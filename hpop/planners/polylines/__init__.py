"""Polylines that programs take and give, and the planners whose paths they begin with."""
