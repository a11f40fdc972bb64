"""Cameras that see a finger on the surface: the role, and its driver for what OpenCV opens."""

from .role import Camera, Frame

__all__ = ["Camera", "Frame"]
