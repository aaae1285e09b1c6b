"""The networks in torch; their acting halves are in :mod:`agents.learned.networks`."""
