"""Friction averaged over the period: averages, their map and inverse, integrator."""
