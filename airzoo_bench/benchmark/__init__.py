"""The benchmark folder: its manifest, its photos, and what truth is made from."""
