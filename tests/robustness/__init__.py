"""Damaged and hostile input."""
