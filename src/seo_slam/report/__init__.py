"""Reports of a run: they read results and never touch the map."""
