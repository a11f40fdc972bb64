from .card_twin import Card as Card
from .card_twin import CardTwin as CardTwin
from .twin import DaqTwin as DaqTwin
