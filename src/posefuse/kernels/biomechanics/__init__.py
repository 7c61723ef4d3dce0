"""Kernels of biomechanics: the anatomical chain of a person, and hidden Markov models."""
