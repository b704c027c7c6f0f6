"""Recordings, read lazily, one frame in memory."""
