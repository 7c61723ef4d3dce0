"""Association: which detections of different views show the same person."""
