"""Sight of a camera: distances along bearings, landmarks in view, and the openness of the space round it."""
