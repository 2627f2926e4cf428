"""Viewer's view along a trajectory: the scene, panoramas, video, and a page to ride along."""
