"""How good is a result: against truth, and against itself."""
