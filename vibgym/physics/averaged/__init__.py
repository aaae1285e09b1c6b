"""Friction averaged over the period: averages and integrator."""
