"""A stream of views in, a stream of people out: grouped by time with a bounded wait, followed, and counted."""
