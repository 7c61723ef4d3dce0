"""Numba only: float64 arrays and scalars in, arrays and status codes out.

Kernels raise nothing and import nothing of ours above them. NaN means missing, so no kernel is compiled
with the fast-math flags that assume it away: ``contract`` (fused multiply-add) is the only one allowed.
Every public kernel has a slow, obvious twin in ``tests/reference`` and runs in CI without the compiler too.
"""
