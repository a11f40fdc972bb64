"""A simulated beam with glued piezo patches."""

from haploop_acme_beam.beam import Beam

__all__ = ["Beam"]
