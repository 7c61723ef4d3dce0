"""Consensus triangulation."""
