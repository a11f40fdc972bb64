from .entry import Entry as Entry
from .index import list_files as list_files
from .lineage import Lineage as Lineage
from .lineage import Member as Member
from .lineage import Node as Node
from .lineage import lineage as lineage
from .sources import stated as stated
