"""The planar model: which elements a part lies on, and what friction there does to it."""
