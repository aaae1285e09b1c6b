"""Learned policies as they act: NumPy and safetensors, without torch. How they are trained is :mod:`agents.training`."""
