"""Parts of the detection of people in videos."""
