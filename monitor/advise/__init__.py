"""Model and verdict to safe settings, or the reason for none."""
