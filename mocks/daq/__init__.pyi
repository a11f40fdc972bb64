from .card_twin import Card as Card
from .card_twin import CardTwin as CardTwin
from .products import PRODUCTS as PRODUCTS
from .products import Product as Product
from .twin import DaqTwin as DaqTwin
