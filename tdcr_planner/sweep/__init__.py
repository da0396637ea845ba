"""Sweeps: scenarios x planners x models x seeds, each job in a process of its own, resumable."""
