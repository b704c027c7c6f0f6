"""One frame to observations: lifting boxes and masks to 3D."""
