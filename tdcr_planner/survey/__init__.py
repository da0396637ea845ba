"""Looking at a file of a place: what it holds, where a robot fits in, and a scenario that plans there."""
