"""Exports of historians to samples."""
