"""Recording files: format, writing, reading, salvage, rejections, export."""

from haploop.acquisition.recording.file_format import (
    BLOCK,
    EVENT,
    FLAGS,
    VERDICT,
    Contents,
    Event,
    Header,
    PressVerdict,
    file_name,
    to_codes,
)
from haploop.acquisition.recording.recording import Recording
from haploop.acquisition.recording.recovery import recover, set_aside
from haploop.acquisition.recording.rejections import Rejection, add_rejections
from haploop.acquisition.recording.salvage import finish, opened, verify
from haploop.acquisition.recording.writer import Writer, check_destination, fresh_file, sync_folder

__all__ = [
    "BLOCK",
    "EVENT",
    "FLAGS",
    "VERDICT",
    "Contents",
    "Event",
    "Header",
    "PressVerdict",
    "Recording",
    "Rejection",
    "Writer",
    "add_rejections",
    "check_destination",
    "file_name",
    "finish",
    "fresh_file",
    "opened",
    "recover",
    "set_aside",
    "sync_folder",
    "to_codes",
    "verify",
]
