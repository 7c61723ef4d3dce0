"""Time offsets of views from the sound that their cameras recorded."""
