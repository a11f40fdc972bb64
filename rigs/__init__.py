"""Rig files that haploop ships: data, found by their bare names."""
