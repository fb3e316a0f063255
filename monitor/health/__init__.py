"""Each sample to a loop's condition."""
