"""Networks as they act: what torch has trained, in NumPy, under the same names of tensors."""
