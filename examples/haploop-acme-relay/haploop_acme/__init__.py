"""ACME's RB-8 relay board for haploop."""
