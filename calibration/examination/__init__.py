"""Examination of a rig: tests that it is wired and set as its file says."""

from .examine import examine, examine_each
from .finding import Finding, Status

__all__ = ["Finding", "Status", "examine", "examine_each"]
