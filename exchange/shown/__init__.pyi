from .columns import columns_figure as columns_figure
from .understanding import understanding_contents as understanding_contents
