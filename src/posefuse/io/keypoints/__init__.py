"""2D keypoints: a module a format, each with ``matches(path)`` and ``read(path, request)``."""
