"""Files of other programs: exports of everything that haploop writes, and presses imported from elsewhere.

A kind of file is read into one of four views (`views`): signals over time, responses over frequency, a
table of presses, or the envelope of one press. A format is one small module that writes a view, and reads
it where a press can come from such a file. `formats` is the table of what goes into what. Names are loaded
when they are first used; `__init__.pyi` lists them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
