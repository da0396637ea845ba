"""Results as files for people: JSON, CSV, pictures and HTML."""
