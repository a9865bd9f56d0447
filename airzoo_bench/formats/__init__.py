"""Kinds of files, read as hostile input in bounded memory; they know no track."""
