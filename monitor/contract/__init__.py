"""What crosses the threshold: samples, loops, records, evidence, times, text, keys."""
