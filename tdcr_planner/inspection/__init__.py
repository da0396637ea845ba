"""Inspection: which points of a surface a robot's camera sees, and paths that see them."""
