"""Live tracking: views in, people out, grouped by time with a bounded wait, tracked and counted."""
