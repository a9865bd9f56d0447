"""What CI runs on a pull request: read as blobs, checked, re-scored, commented, counted."""
