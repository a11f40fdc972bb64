"""The commands of `haploop`, one file a family."""
