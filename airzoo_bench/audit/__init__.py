"""Published tables held against arithmetic: what printed numbers alone can prove."""
