"""Calibration: the parameters of a real robot from what a test bench has measured."""
