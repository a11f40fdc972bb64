"""The commands of experiments: `haploop experiment` and `haploop analyse`."""
