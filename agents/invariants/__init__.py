"""What must hold of every run, whatever the network and the machines did: one checker for all drivers.

It reads a run's history: what was said, and what truly happened to processes and links. The virtual-time
engine writes one, so does a campaign with real processes, and a run directory can be read again.
"""

from agents.invariants.check import check
from agents.invariants.history import RunHistory
from agents.invariants.report import Report, Violation

__all__ = ["Report", "RunHistory", "Violation", "check"]
