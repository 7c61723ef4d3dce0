"""The error law of detections: scale, exponent and tails, estimated by leaving views out."""
