"""To look at a result: in rerun's viewer, and drawn on pictures."""
