"""Commands on files of other programs: `haploop import`, `export`."""
