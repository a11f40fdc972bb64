"""Experiments that are shipped, as TOML files: the paper's two, and one of each other kind."""
