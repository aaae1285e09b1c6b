"""Speed against error: an independent reference, and the peers that the models of ``vibgym`` are measured against.

Needs the extra ``accuracy`` (SciPy, shapely); the MuJoCo peer needs the extra ``mujoco`` besides.
"""
