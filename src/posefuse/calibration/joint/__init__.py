"""One estimate of camera poses, time offsets, clock drifts and noise from tracked keypoints."""
