"""Shape models: one protocol for the reference, the learned model and constant curvature."""
