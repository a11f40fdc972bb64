"""Rig files that differ from another one in a few values."""

from typing import Any

from haploop.instruments import RigFile


def changed(file: RigFile, **sections: Any) -> RigFile:
    """The file with other values: a dict changes that of a section, anything else replaces the section."""
    new = {
        name: getattr(file, name).model_copy(update=value) if isinstance(value, dict) else value
        for name, value in sections.items()
    }
    return file.model_copy(update=new)
