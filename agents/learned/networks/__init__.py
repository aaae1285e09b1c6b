"""Networks that act on parts: torch for training, NumPy for acting; the same numbers from the same tensors."""
