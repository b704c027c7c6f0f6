"""Published protocols: trajectories and landmarks."""
