"""What nonlinear programs of several planners share."""
