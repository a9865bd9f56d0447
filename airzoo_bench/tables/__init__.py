"""Tables: one model, many renderers; a table knows nothing of tracks."""
