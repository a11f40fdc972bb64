"""The simulated part of haploop: the plant, the instruments' twins and wires, and faults."""
