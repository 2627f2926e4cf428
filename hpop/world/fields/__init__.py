"""Scalar fields over the plane, and what is sampled into them."""
