"""jit and its cache, records, the drive."""
