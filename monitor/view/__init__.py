"""What is published, as pictures."""
