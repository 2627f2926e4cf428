"""Viewer's view along a trajectory: the drawn scene, panoramas, 360 degree videos, and a page to ride along."""
