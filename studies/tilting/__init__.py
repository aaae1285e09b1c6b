"""Above the plane: what tips parts, what it does to them, and how policies that never met it get on."""
