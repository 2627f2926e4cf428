"""Criteria of the robot: time, energy, clearance, joints."""
