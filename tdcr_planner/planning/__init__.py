"""Scenarios, configuration space, validity and the OMPL search."""
