"""Two roles for haploop: a thermometer and a camera, both recorded along with presses."""
