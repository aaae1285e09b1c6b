"""Speed against error: an independent reference, peers for comparison with the models of ``vibgym``, and a report.

``python -m studies.accuracy CONFIG`` plots error against cost on shipped or user-defined scenes; see ``configs/accuracy``.

Needs the extra ``accuracy`` (SciPy, shapely, and for the page jinja2, matplotlib); the MuJoCo peer needs the extra
``mujoco`` as well.
"""
