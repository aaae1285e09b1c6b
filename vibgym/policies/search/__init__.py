"""Policies that look ahead: they try plans in a simulation of their own."""
