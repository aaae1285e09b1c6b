"""Compiled physics: functions of arrays in SI units, independent of settings, random generators and environments.

Entry points: :func:`vibgym.physics.planar.friction.slide_rows`, :func:`vibgym.physics.contacts.certified.period.resolve`,
:func:`vibgym.physics.averaged.integrator.advance_worlds` and :func:`vibgym.physics.core.drive.element_phasor`.
"""
