"""Statistics on records: intervals, paired tests, comparisons; they know nothing of tracks."""
