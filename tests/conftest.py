"""Shared by all tests."""

from hypothesis import settings

# Kernels compile on first use, so a first example may take seconds; and a suite that proves something must be repeatable.
settings.register_profile("vibgym", deadline=None, derandomize=True, max_examples=100)
settings.load_profile("vibgym")
