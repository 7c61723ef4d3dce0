"""Reference implementations of the kernels in slow, plain NumPy and SciPy."""
