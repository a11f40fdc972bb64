"""The commands of `haploop`, one file for each group."""
