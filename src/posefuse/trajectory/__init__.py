"""One solve over a whole recording: paths that explain every view, move smoothly and keep their bones' lengths."""
