"""Pictures and reports, made from records and results."""
