"""Live sessions: a viewer chooses where the robot goes, is offered ways, and drives (``hpop live``)."""
