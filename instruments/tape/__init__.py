"""A session's tape: every call between haploop and its devices, written to a file and played back.

A call is what a driver hands to what it does not own: NI's library, a serial port, a hub, PortAudio, OpenCV.
At that boundary, and nowhere else, a driver calls through a `TapedLine`. It makes the call; a recorder writes
it down as well; a player answers it from the file, and makes none. So a rig that is played back runs the real
drivers and opens no hardware.

A tape is gzip of JSON lines (`zcat`, `jq`), each with the hash of all lines so far. The last line says that
it is the last.
"""

from .lines import Failure, Proxied, TapedLine, on_line, taped_line
from .masking import mask
from .player import Player, TapeClock, TapeError
from .recorder import Recorder
from .sessions import current, played, recorded
from .tape_file import TapeLines
from .values import Handle

__all__ = [
    "Failure",
    "Handle",
    "Player",
    "Proxied",
    "Recorder",
    "TapeClock",
    "TapeError",
    "TapeLines",
    "TapedLine",
    "current",
    "mask",
    "on_line",
    "played",
    "recorded",
    "taped_line",
]
