"""Trained policies in NumPy and safetensors, without torch. Training is in :mod:`agents.train`."""
