"""Other machines of the thesis's Table 1.1 on the same tasks, in the same simulator."""
