"""Published tables checked by arithmetic."""
