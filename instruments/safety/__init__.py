"""Keep volts within limits and bring a rig to its safe state.

Names are loaded when they are first used; `__init__.pyi` lists them: who reads a log needs no limiter.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
