"""Recording files: format, writing, reading, salvage, rejections, export."""

from haploop.acquisition.recording.export import to_pandas, to_xarray
from haploop.acquisition.recording.file_format import Contents, Header, file_name, to_codes
from haploop.acquisition.recording.part_reader import PartReader
from haploop.acquisition.recording.readings import AlongFile, AlongReading, reading_event
from haploop.acquisition.recording.recording import Recording
from haploop.acquisition.recording.recovery import recover, set_aside
from haploop.acquisition.recording.rejections import Rejection, add_rejections
from haploop.acquisition.recording.rows import BLOCK, EVENT, FLAGS, VERDICT, Event, PressVerdict
from haploop.acquisition.recording.salvage import content_hash, finish, verify
from haploop.acquisition.recording.writer import Writer

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
    "to_pandas",
    "to_xarray",
    "verify",
]
