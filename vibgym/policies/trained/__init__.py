"""Learned policies as they act: NumPy and safetensors, without torch. Training is in :mod:`agents.train`."""
