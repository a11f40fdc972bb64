from .card_twin import Card as Card
from .card_twin import CardTwin as CardTwin
from .products import PRODUCTS as PRODUCTS
from .products import Product as Product
from .signals import Signal as Signal
from .signals import Wire as Wire
from .signals import signal_of as signal_of
from .twin import DaqTwin as DaqTwin
