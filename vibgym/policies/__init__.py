"""Who acts: the protocol of policies, classical controllers and trained agents, and how their episodes are played."""

from vibgym.policies.registry import CONTROLLERS, make_policy
from vibgym.policies.rollout import rollout

__all__ = ["CONTROLLERS", "make_policy", "rollout"]
