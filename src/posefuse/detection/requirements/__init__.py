"""Pinned packages of the environments of detectors, with hashes."""
