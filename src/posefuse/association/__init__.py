"""Who is whose, within a frame and across views."""
