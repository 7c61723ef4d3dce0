"""Files to nouns and back; one file a format, nothing but conversion."""
