from .entry import Entry as Entry
from .index import list_files as list_files
