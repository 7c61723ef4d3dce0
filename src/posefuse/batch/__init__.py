"""Many recordings side by side: what is to be done, who does it, what came of it."""
