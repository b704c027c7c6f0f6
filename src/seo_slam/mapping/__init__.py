"""The object map and the life of its landmarks."""
