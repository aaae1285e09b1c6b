"""Sliding and static friction of a flat part, resolved in time."""
