"""The long-running monitor: bus to engine to store to bus."""
