"""Collision tests of robots made of upright prisms: in the plane for planning, and by python-fcl for verification."""
