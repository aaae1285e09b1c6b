"""Above the plane: parts as rigid bodies on plates whose heights differ."""
