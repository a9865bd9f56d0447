"""Tables: one model, many renderers; a table knows no track."""
