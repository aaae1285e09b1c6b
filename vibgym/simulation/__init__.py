"""The simulator and its models."""

from vibgym.simulation.model import Conditions, Model, Setup
from vibgym.simulation.models import MODELS
from vibgym.simulation.simulator import Simulator

__all__ = ["MODELS", "Conditions", "Model", "Setup", "Simulator"]
