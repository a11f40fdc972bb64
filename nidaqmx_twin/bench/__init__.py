"""A bench: simulated cards, what their inputs read, their wires and their failures, in a file."""

from .cards import cards as cards
from .file import Bench as Bench
from .file import devices_of as devices_of
from .file import read_bench as read_bench
