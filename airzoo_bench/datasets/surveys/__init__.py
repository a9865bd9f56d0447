"""Own surveys as other programs leave them: a folder of photos, a project, a model, a table."""
