"""Certified contacts: conservative advancement, impacts one by one, impulses of contacts at rest, islands."""
