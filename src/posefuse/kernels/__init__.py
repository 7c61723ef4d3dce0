"""Compiled numerical kernels: float64 arrays and scalars in, arrays and status codes out.

Kernels use Numba only. They raise no exceptions and import nothing of posefuse outside this package. NaN means missing,
so no kernel is compiled with the fast-math flags that assume its absence: every kernel allows ``contract`` (fused
multiply-add), and ``vectorized`` subroutines also allow ``reassoc``. Public kernels have slow, plain reference
implementations in ``tests/reference``, and continuous integration also runs them without the compiler.
"""
