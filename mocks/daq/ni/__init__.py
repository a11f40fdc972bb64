"""Simulated NI cards (`nidaqmx_twin`) as the wire of a rig."""
