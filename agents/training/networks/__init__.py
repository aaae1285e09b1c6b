"""The networks in torch; their acting halves are in :mod:`vibgym.policies.trained.networks`."""
