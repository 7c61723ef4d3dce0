"""Results: a module a format, each with ``write(result, folder, layer)`` or the like."""
