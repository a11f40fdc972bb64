"""Two roles for haploop: a thermometer and a microscope, both recorded along with presses."""
