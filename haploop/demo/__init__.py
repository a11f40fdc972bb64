"""The complete workflow on a simulated rig, with a report."""

from haploop.demo.run import claim_folder, run_demo

__all__ = ["claim_folder", "run_demo"]
