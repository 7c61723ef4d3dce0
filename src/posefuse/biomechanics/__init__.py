"""Derive body measurements from reconstructions: angles, centers of mass, segment lengths, animation skeletons."""
