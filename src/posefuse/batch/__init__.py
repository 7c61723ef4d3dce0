"""Reconstruct many recordings side by side: jobs, worker processes, clusters."""
