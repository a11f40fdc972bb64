"""Simulated participants, who answer by a psychometric model."""

from haploop.mocks.participant.model import ParticipantModel, load_participant_model
from haploop.mocks.participant.participant import SimulatedParticipant

__all__ = ["ParticipantModel", "SimulatedParticipant", "load_participant_model"]
