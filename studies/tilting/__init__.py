"""Studies of the tilting model: accuracy, energy, cost, and releases from a tilt."""
