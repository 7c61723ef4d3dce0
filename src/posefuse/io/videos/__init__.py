"""Videos: pictures with times, in and out."""
