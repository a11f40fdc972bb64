"""Exit codes and console output of commands."""
