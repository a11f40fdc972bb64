"""A session's tape: every call between haploop and its devices, written to a file and played back.

A call is what a driver hands to what it does not own: NI's library, a serial port, a hub, PortAudio, OpenCV.
At that boundary, and nowhere else, a driver calls through a `TapedLine`. It makes the call; a recorder writes
it down as well; a player answers it from the file, and makes none. So a rig that is played back runs the real
drivers and opens no hardware.

A tape is gzip of JSON lines (`zcat`, `jq`), each with the hash of all lines so far. The last line says that
it is the last.
"""

from .player import Player as Player
from .player import TapeClock as TapeClock
from .player import TapeError as TapeError
from .recorder import Call as Call
from .recorder import Failure as Failure
from .recorder import Proxied as Proxied
from .recorder import Recorder as Recorder
from .recorder import TapedLine as TapedLine
from .recorder import on_line as on_line
from .recorder import taped_line as taped_line
from .sessions import current as current
from .sessions import mask as mask
from .sessions import played as played
from .sessions import recorded as recorded
from .sessions import recording_of as recording_of
from .tape_file import Handle as Handle
from .tape_file import TapeLines as TapeLines
