"""From a protocol, a benchmark folder and a prediction file to records and a result."""
