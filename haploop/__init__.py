"""haploop: from a physical button to a verified digital one.

The rooms' public names in one place, so that a script needs one import. Names are loaded when they are
first used, so that `import haploop` is cheap; `__init__.pyi` lists them.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
