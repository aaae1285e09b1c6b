"""What is released is built, looked into, and tried where nothing else is: ``python -m studies.release`` (``make release``)."""
