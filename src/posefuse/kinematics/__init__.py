"""Poses of bodies, joint angles and their standard deviations, and the twist of limbs."""
