"""Observations and landmarks to an assignment."""
