"""All that is simulated: the plant, the twins of instruments, their wires, and faults."""
