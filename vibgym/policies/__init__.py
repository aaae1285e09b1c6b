"""Policies: their protocol and registry, classical controllers and trained agents, and rollouts."""

from vibgym.policies.classical.lanes import LanesPolicy
from vibgym.policies.classical.law import Law, LocalLaw
from vibgym.policies.classical.linear_laws import LqrLaw, PidLaw
from vibgym.policies.classical.open_loop import OpenLoopPolicy, RandomPolicy, ZeroPolicy
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.pose_law import PoseLaw
from vibgym.policies.classical.pushing import PushingPolicy
from vibgym.policies.classical.steering import LocalFieldPolicy
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.mpc import MPCPolicy
from vibgym.policies.parallel_rollout import ParallelRolloutPolicy
from vibgym.policies.registry import by_task, make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import POLICIES, Policy, TaskInfo
from vibgym.policies.trained.catalogue import Learned
from vibgym.policies.trained.residual import Residual
from vibgym.policies.trained.trained import Trained

__all__ = ["POLICIES", "Law", "Policy", "TaskInfo", "make_policy", "rollout"]

for _name, _policy in {
    # For all tasks.
    "zero": ZeroPolicy,
    "random": RandomPolicy,
    # For one part with a fixed goal pose.
    "open_loop": OpenLoopPolicy,
    # For goals, zones or a distance to keep: every part straight there; past the others.
    "local_field": LocalFieldPolicy,
    "planner": PlannerPolicy,
    # For parts that pass one another or leave through gates; patterns too tight for the planner; a part pushed by others.
    "lanes": LanesPolicy,
    "two_phases": TwoPhasesPolicy,
    "push": PushingPolicy,
    # For all tasks whose goals stay, by simulation; for the tasks that it names.
    "mpc": MPCPolicy,
    "parallel_rollout": ParallelRolloutPolicy,
    "by_task": by_task,
    # From files: the shipped agent, and others.
    "learned": Learned,
    "trained": Trained,
    "residual": Residual,
    # Control laws.
    "local": LocalLaw,
    "pose": PoseLaw,
    "lqr": LqrLaw,
    "pid": PidLaw,
}.items():
    POLICIES.register(_name, _policy)
