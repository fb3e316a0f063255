"""Model and event to index, evidence and a verdict on the tuning."""
