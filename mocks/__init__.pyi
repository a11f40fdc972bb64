from .participant import ParticipantModel as ParticipantModel
from .participant import SimulatedParticipant as SimulatedParticipant
from .participant import load_participant_model as load_participant_model
