"""The console's server: pages, snapshot and live blocks for browsers, commands from them to the worker."""

from .security import Access
from .serving import application, serve_console

__all__ = ["Access", "application", "serve_console"]
