"""Compiled physics: arrays in, arrays out, SI units throughout.

Nothing here reads settings, draws random numbers or knows about environments. Public entry points are
:func:`vibgym.physics.planar.friction.advance_worlds` and :func:`vibgym.physics.core.drive.element_phasor`.
"""
