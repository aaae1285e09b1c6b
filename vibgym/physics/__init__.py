"""Compiled physics: arrays in, arrays out, SI units throughout; no settings, no random generators, no environments.

Entry points: :func:`vibgym.physics.planar.friction.slide_rows`, :func:`vibgym.physics.contacts.multibody.resolve`,
:func:`vibgym.physics.averaged.integrator.advance_worlds` and :func:`vibgym.physics.core.drive.element_phasor`.
"""
