"""haploop's own kinds of fault, one module for each place of action. Rig files name them by entry point."""
