"""Build, inspect and install sdist and wheel: ``python -m studies.release`` (``make release``)."""
