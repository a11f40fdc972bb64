"""Simulated NI cards for anybody who writes nidaqmx: `README.md` in this folder says how they are used.

NI's own gRPC service behind the real `nidaqmx` package (`server`), which a program reaches unchanged
(`redirect`), in its own tests (`twin`, `pytest_plugin`) or as a whole (`bench`, `python -m`). What stands at
the terminals fulfils `nodes.Nodes`. It needs nothing of haploop but `base`. Names are loaded when they are
first used; `__init__.pyi` lists them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
