"""What the viewer would see along a trajectory: the scene, pictures all round, video, and a page to ride in."""
