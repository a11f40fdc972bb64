"""haploop: from a physical button to a verified digital one.

A script's names are here; what it needs once in a while is in its room: `haploop.calibration`,
`haploop.instruments`, .... Names are loaded on first use, so that `import haploop` is fast; `__init__.pyi`
lists them.
"""

from .base import at_once

if at_once.is_the_command():  # before what takes a moment to load
    at_once.end_at_once()

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
