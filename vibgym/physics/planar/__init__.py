"""The planar model: contact area on the elements, and friction."""
