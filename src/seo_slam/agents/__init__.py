"""Agents look at the map projected into an image and propose edits (SEO-SLAM III-C to III-E)."""
