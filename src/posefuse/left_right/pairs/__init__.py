"""Left and right points of pairs of keypoints, solved together; one file per method."""
