"""An independent reference for parts that rock and tilt: a rigid body on many stiff compliant contact points.

It shares no code with the models of :mod:`vibgym.physics`. ``python -m studies.accuracy.rigid`` measures what it is for.
"""
