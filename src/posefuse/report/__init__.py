"""A reconstruction as one self-contained page."""
