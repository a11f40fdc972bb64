"""Simulated participants, who answer by a psychometric model."""

from .model import ParticipantModel, load_participant_model
from .participant import SimulatedParticipant

__all__ = ["ParticipantModel", "SimulatedParticipant", "load_participant_model"]
