"""Examination of a rig: tests that it is wired and set as its file says."""

from haploop.calibration.examination.examine import examine, examine_each
from haploop.calibration.examination.finding import Finding, Status

__all__ = ["Finding", "Status", "examine", "examine_each"]
