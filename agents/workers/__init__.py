"""Where work is done: here, in processes of this machine, or on a Ray cluster. What comes of it is the same."""

from agents.workers.cluster import NoCluster
from agents.workers.local import Submit, usable
from agents.workers.places import side_by_side

__all__ = ["NoCluster", "Submit", "side_by_side", "usable"]
