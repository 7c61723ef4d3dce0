"""Cross-view agreement, proposals and trunks."""
