"""A simulated robot that a navigator drives through a simulated home, and trials of it."""
