"""Figures of a result as PNG and SVG, for papers and slides."""
