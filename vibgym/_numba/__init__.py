"""Everything that leans on numba's private parts."""
