"""Occlusion and forward kinematics of simulated bodies."""
