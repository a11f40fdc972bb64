"""Recording files: format, writing, reading, salvage, rejections, export."""

from .file_format import Contents, Header, file_name, to_codes
from .part_reader import PartReader
from .readings import AlongFile, AlongReading, reading_event
from .recording import Recording
from .recovery import recover, set_aside
from .rejections import Rejection, add_rejections
from .rows import BLOCK, EVENT, FLAGS, VERDICT, Event, PressVerdict
from .salvage import content_hash, finish, verify
from .whole import write_recording
from .writer import Writer

__all__ = [
    "BLOCK",
    "EVENT",
    "FLAGS",
    "VERDICT",
    "AlongFile",
    "AlongReading",
    "Contents",
    "Event",
    "Header",
    "PartReader",
    "PressVerdict",
    "Recording",
    "Rejection",
    "Writer",
    "add_rejections",
    "content_hash",
    "file_name",
    "finish",
    "reading_event",
    "recover",
    "set_aside",
    "to_codes",
    "verify",
    "write_recording",
]
