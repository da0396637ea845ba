"""A query from top to bottom: its environment, the attempts to answer it, the reference's judgement, the result."""
