"""The NI-DAQmx wire."""
