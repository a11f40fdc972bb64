"""The simulated person at the rig."""
