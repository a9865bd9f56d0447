"""Published tables checked by arithmetic: what printed numbers alone can prove."""
