"""Figures of the thesis, reproduced: ``python -m studies.thesis``."""
