"""Simulated participants, who answer by a psychometric model."""

from .participant import ParticipantModel, SimulatedParticipant, load_participant_model

__all__ = ["ParticipantModel", "SimulatedParticipant", "load_participant_model"]
