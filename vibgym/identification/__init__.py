"""System identification: parameters of a machine from recorded commands and camera poses."""

from vibgym.identification.excitation import Excitation
from vibgym.identification.fit import fit
from vibgym.identification.log import Log
from vibgym.identification.machine import Camera, record
from vibgym.identification.outcome import Fitted

__all__ = ["Camera", "Excitation", "Fitted", "Log", "fit", "record"]
