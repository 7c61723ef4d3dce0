"""Anti-aliased drawing."""
