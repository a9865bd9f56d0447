"""What reads files as methods write them: a file a layout, named in `core.registry.READERS`."""
