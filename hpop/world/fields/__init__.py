"""Scalar fields over the plane, and the sampling of obstruction and clearance."""
