"""The viewer: a result in rerun."""
