"""The robot's body against triangle meshes: contact, containment and clearance."""
