"""Bodies in numbers: where their mass is, and how long their segments are."""
