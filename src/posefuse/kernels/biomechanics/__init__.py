"""Kernels of biomechanics: the anatomical chain of a person."""
