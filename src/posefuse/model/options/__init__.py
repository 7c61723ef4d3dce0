"""Requested options: one frozen record per stage."""
