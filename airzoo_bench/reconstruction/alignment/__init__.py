"""A prediction brought into the frame of the truth."""
