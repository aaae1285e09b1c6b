"""The machines of the thesis's Table 1.1 that are no segmented surface, on the same tasks and in the same simulator."""
