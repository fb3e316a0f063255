"""Bytes to entries, records to bytes, and back."""
