"""System identification: parameters of a machine from recorded commands and camera poses."""

from vibgym.identification.log import Log

__all__ = ["Log"]
