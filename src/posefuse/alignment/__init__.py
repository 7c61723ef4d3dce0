"""Align the world with the floor, the up and forward directions, and a known size."""
