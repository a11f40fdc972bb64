"""Any instrument from a table of commands and answers: on a serial line, by VISA, HTTP or a socket."""

from .instrument import Instrument as Instrument
from .instrument import Table as Table
from .instrument import read_table as read_table
from .serving import Served as Served
from .serving import serving as serving
from .twins import InstrumentTwins as InstrumentTwins
