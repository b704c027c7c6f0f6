"""Worlds of which everything is known."""
