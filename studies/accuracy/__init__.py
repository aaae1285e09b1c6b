"""Speed against error: an independent reference, the peers that the models of ``vibgym`` are measured against, and a report.

``python -m studies.accuracy CONFIG`` draws error against cost on shipped scenes or your own; see ``configs/accuracy``.

Needs the extra ``accuracy`` (SciPy, shapely, and for the page jinja2, matplotlib); the MuJoCo peer needs the extra
``mujoco`` as well.
"""
