"""Statistics on records: intervals, paired tests, comparisons, and the tables that tell of them."""
