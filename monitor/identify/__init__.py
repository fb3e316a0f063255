"""An event's window to a process model with intervals."""
