"""HTML reports of a demo run and of a recalibration."""
