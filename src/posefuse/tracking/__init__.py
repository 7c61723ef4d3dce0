"""People over time: articulated states put right by detections, their births, losses and returns."""
