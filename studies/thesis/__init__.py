"""Figures of the thesis, repeated: ``python -m studies.thesis``."""
