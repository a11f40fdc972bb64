"""The console's worker: the process that holds the rig, and how others find it and talk to it."""

from haploop.console.worker.address import Address
from haploop.console.worker.link import WorkerHangsError, WorkerLink, find_worker, serving, start_worker

__all__ = ["Address", "WorkerHangsError", "WorkerLink", "find_worker", "serving", "start_worker"]
