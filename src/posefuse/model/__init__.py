"""The nouns: frozen, checked on construction; no files, no algorithms."""
