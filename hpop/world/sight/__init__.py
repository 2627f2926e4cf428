"""Sight of a camera: distances along bearings, landmarks, openness."""
