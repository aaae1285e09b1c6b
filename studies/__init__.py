"""Measurements, benchmarks and replications; not needed to use vibgym."""
