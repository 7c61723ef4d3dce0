"""Write OpenSim's models and setups, and run its tools; only these files use the package ``opensim``."""
