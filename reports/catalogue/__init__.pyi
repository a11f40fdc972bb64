from .entry import Entry as Entry
from .entry import stated as stated
from .index import list_files as list_files
from .lineage import Lineage as Lineage
from .lineage import Member as Member
from .lineage import Node as Node
from .lineage import lineage as lineage
