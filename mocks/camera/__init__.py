"""The camera's twin: rendered infra-red images of the finger on the surface."""

from haploop.mocks.camera.twin import PIXELS_PER_METRE, CameraTwin

__all__ = ["PIXELS_PER_METRE", "CameraTwin"]
