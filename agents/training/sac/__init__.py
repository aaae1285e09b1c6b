"""SAC on the flat state."""
