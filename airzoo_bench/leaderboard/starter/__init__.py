"""The files that a board begins with."""
