"""Object-level semantic SLAM: RGB-D frames in, a map of things out."""

__version__ = "0.1.0"
