"""All that is known of a loop to its one row."""
