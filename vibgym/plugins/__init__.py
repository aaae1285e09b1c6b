"""Plug-ins in the wheel: the tilting model, the camera and the play page.

They use the extension points that third-party packages have (entry points of pyproject.toml); the core imports none of them.
"""
