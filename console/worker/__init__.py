"""The console's worker: the process that holds the rig, and how others find it and talk to it."""

from .link import Address, WorkerHangsError, WorkerLink, find_worker, free_tape, serving, start_worker

__all__ = ["Address", "WorkerHangsError", "WorkerLink", "find_worker", "free_tape", "serving", "start_worker"]
