"""Naive twins: the kernels' specification in slow, obvious NumPy and SciPy."""
