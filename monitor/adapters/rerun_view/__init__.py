"""Pictures in Rerun."""
