"""Collision geometry of robots made of upright prisms: in the plane for planning, in space by python-fcl to judge."""
