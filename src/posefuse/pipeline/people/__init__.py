"""Track people through a recording or frame by frame: association and tracking wired together."""
