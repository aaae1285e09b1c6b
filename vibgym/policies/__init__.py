"""Policies: their protocol, classical controllers and trained agents, and rollouts."""

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.steering import LAWS
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import CONTROLLERS, make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo

__all__ = ["CONTROLLERS", "LAWS", "Law", "Policy", "TaskInfo", "make_policy", "rollout"]
