"""The ways in and out, one outside library each."""
