"""Detection of the corners of calibration boards, by OpenCV."""
