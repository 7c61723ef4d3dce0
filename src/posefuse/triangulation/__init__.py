"""From 2D detections of known people to 3D points: one file a method, chosen by name."""
