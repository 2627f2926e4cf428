"""Shapes in the plane and solids in space, with distances, crossings and rays."""
