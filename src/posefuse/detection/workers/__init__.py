"""Worker programs: they run in a detector's own environment, with Python 3.8 or later, NumPy and the detector alone."""
