"""The ground floor: errors, clocks, signals, files and their stores. It imports nothing else of haploop."""
