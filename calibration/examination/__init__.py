"""Examination of a rig: tests that it is wired and set as its file says."""

from .examine import examine, examine_each
from .finding import Finding, Status
from .loop_check import examine_loop

__all__ = ["Finding", "Status", "examine", "examine_each", "examine_loop"]
