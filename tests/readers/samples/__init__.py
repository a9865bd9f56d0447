"""Files as methods write them, made by each layout's own rules from a known truth.

A module a layout: its ``write(folder, place)`` writes a sample into an empty folder and returns the
path that is given to the suite. The module in which the class of `place` stands has
``make_world(folder)``, which makes one. `test_all` takes every module with a ``write``; its reader
is ``READER``, or has the module's own name.
"""
