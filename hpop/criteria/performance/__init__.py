"""Criteria of performance: what the camera sees."""
