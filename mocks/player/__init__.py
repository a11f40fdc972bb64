"""The simulated sound card."""
