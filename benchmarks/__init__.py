"""Accuracy and speed, side by side with the peers. ``make benchmark`` runs all of it."""
