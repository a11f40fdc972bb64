from .products import PRODUCTS as PRODUCTS
from .products import Product as Product
from .twin import DaqTwin as DaqTwin
