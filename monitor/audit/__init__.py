"""Historian exports to tables of events and loops."""
