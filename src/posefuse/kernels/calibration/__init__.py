"""Bundle adjustment terms."""
