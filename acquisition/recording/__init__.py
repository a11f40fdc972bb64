"""Recording files: format, writing, reading, salvage, rejections, export."""

from .file_format import Contents as Contents
from .file_format import Header as Header
from .file_format import file_name as file_name
from .file_format import refuse_name as refuse_name
from .file_format import to_codes as to_codes
from .part_reader import PartReader as PartReader
from .recording import Recording as Recording
from .recording import Rejection as Rejection
from .recording import add_rejections as add_rejections
from .recovery import recover as recover
from .recovery import set_aside as set_aside
from .rows import BLOCK as BLOCK
from .rows import EVENT as EVENT
from .rows import FLAGS as FLAGS
from .rows import VERDICT as VERDICT
from .rows import Event as Event
from .rows import PressVerdict as PressVerdict
from .salvage import content_hash as content_hash
from .salvage import finish as finish
from .salvage import verify as verify
from .streams import AlongFile as AlongFile
from .streams import AlongReading as AlongReading
from .streams import RecordedStream as RecordedStream
from .streams import reading_event as reading_event
from .writer import Writer as Writer
from .writer import write_recording as write_recording
