"""A small world in which everything is known: simulated scenes, sensors and detectors."""
