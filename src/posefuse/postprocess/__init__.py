"""Fill gaps, smooth points, and make bone lengths constant."""
