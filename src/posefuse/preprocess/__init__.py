"""Match views to cameras, build the common timeline, weight detections and apply time offsets."""
