"""Scene surfaces from point clouds, such as laser scans: reading the points, and the obstacle that they make."""
