"""Which of a pair's two points is the left one; one file a method, chosen by name in ``registry.py``."""
