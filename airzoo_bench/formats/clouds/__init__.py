"""Point clouds and meshes in the formats that people write them in, read as hostile input."""
