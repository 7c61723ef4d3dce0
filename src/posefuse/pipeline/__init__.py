"""Recipes: each wires the stages into one job and reads top to bottom."""
