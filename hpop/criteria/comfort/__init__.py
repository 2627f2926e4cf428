"""J_C: comfort of the immersed user."""
