"""Episodes of a policy as a Minari data set: ``python -m agents record CONFIG``."""
