"""The Python face: what `airzoo_bench` offers under its own name, a file a theme.

Array-likes come in, and leave as plain numbers, arrays or small result objects. Numbers are those
of the tracks, by the tracks' own code; arguments that do not fit are an `ArgumentError`.
"""
