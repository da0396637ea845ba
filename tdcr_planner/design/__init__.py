"""Design: which robot for a scene, searched over the numbers of its file."""
