"""The public board: JSON files of a stable API, pages made of them alone and downloads."""
