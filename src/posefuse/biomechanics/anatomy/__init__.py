"""Describe the human body as OpenSim models do: bodies, joints and coordinates with their published parameters."""
