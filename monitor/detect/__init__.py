"""Samples to events."""
