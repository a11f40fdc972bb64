"""The camera's twin: rendered infra-red images of the finger on the surface."""

from .twin import PIXELS_PER_METRE, CameraTwin

__all__ = ["PIXELS_PER_METRE", "CameraTwin"]
