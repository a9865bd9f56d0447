"""What every room stands on: errors, files, settings, processes; it knows nothing of the field."""
