"""Adopting somebody else's network as a shape model: its convention found, its faults named, its errors measured."""
