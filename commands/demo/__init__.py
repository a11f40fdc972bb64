"""`haploop demo`: the complete workflow on a simulated rig, with a report."""
