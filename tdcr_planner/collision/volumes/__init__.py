"""Scene surfaces from images of voxels, such as segmented CT: reading the image and the surface of a region in it."""
