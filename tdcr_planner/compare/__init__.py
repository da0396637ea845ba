"""Comparisons: what a shape model and constant curvature say of configurations, against the Cosserat reference."""
