"""Settings that are too many for config.py, one file a concern."""
