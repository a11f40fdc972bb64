"""haploop's own kinds of fault, a file for each place where they act. Rig files name them by entry point."""
