from .people import ParticipantModel as ParticipantModel
from .people import SimulatedParticipant as SimulatedParticipant
from .people import load_participant_model as load_participant_model
