"""Calibrations: a module a format, each with ``matches(path)`` and ``read(path, unit)``."""
