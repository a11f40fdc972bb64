"""The console's server: pages, snapshot and live blocks for browsers, commands from them to the worker."""

from haploop.console.server.application import application
from haploop.console.server.security import Access
from haploop.console.server.serving import serve_console

__all__ = ["Access", "application", "serve_console"]
