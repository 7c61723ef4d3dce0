"""Left/right pairs and side assignment."""
