"""Figures of the thesis, repeated: ``python -m agents replicate``."""
