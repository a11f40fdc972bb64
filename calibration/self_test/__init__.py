"""Examination of a rig: tests that it is wired and set as its file says."""

from .finding import Finding, Status
from .loop_test import examine_loop
from .self_test import examine, examine_each

__all__ = ["Finding", "Status", "examine", "examine_each", "examine_loop"]
