"""Plug-ins in the wheel: the tilting model, the camera, parts from drawings and the play page.

They use the extension points of third-party packages (entry points in pyproject.toml); the core does not import them.
"""
